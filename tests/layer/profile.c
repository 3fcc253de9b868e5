/* A Vulkan layer that has a driver tell of a lesser device than it runs, to test that a program asks, and heeds the answer.
 *
 *   PROFILE_PUSH=N          bytes of push constants
 *   PROFILE_SUBGROUP=N      threads of a subgroup; shaders run in those of the driver
 *   PROFILE_FEATURES=WORD   needed: of the optional features only those that this program needs; none: not even those
 *   PROFILE_HEAP=N          bytes of each heap; an allocation beyond them fails
 *   PROFILE_MEMORY=split    memory of the device, and four types of host memory, of which two are coherent
 *
 * What is asked for beyond what was told is refused: features of the device, types of memory, and mapping memory that is
 * not coherent, which would have to be flushed.
 */
#include "layer.h"

/* As much of these structures as is read or written here. */
typedef struct {
    Chain chain;
    uint32_t flags, queue_count;
    const void *queues;
    uint32_t layer_count;
    const void *layers;
    uint32_t extension_count;
    const void *extensions;
    const VkBool32 *features;
} DeviceInfo;
typedef struct {
    uint32_t numbers[5];
    char name[256];
    uint8_t cache[16];
    uint32_t aligned, limits[126];
} Properties;
typedef struct {
    uint32_t type_count;
    struct {
        uint32_t flags, heap;
    } types[32];
    uint32_t heap_count;
    struct {
        VkDeviceSize size;
        uint32_t flags;
    } heaps[16];
} Memory;
typedef struct {
    Chain chain;
    VkDeviceSize size;
    uint32_t memory_type;
} AllocateInfo;
typedef struct {
    VkDeviceSize size, alignment;
    uint32_t types;
} Requirements;
typedef struct {
    Chain chain;
    VkBool32 values[];
} Features;

enum { FEATURES_2 = 1000059000, FEATURES_1_2 = 51, SUBGROUP = 1000094000, PROPERTIES_1_1 = 50 };
enum { FEATURES = 55, EXTENDED_FORMATS = 29, OPTIONAL_1_2 = 32, SCALAR_LAYOUT = 31, MAX_PUSH = 8 };
enum { DEVICE = 1, HOST = 2, COHERENT = 4, CACHED = 8 };
static const uint32_t SPLIT[][2] = { { DEVICE, 0 }, { HOST, 1 }, { HOST | CACHED, 1 }, { HOST | COHERENT, 1 },
                                     { HOST | COHERENT | CACHED, 1 } };

static int is(const char *variable, const char *word) {
    const char *given = getenv(variable);
    return given && !strcmp(given, word);
}
static unsigned long long number(const char *variable) {
    const char *given = getenv(variable);
    return given ? strtoull(given, NULL, 10) : 0;
}
static uint32_t split_types(void) { return is("PROFILE_MEMORY", "split") ? sizeof SPLIT / sizeof *SPLIT : 0; }

/* Whether a feature is told, by its place in VkPhysicalDeviceFeatures (kind 0) or VkPhysicalDeviceVulkan12Features. */
static int told(int kind, uint32_t place) {
    int all = !getenv("PROFILE_FEATURES"), needed = is("PROFILE_FEATURES", "needed");
    if (kind == FEATURES_1_2) return all || place >= OPTIONAL_1_2 || (needed && place == SCALAR_LAYOUT);
    return all || place == 0 || (needed && place == EXTENDED_FORMATS); /* the first is robustBufferAccess, which all have */
}

/* The next layer's calls, looked up when the instance is made: the loader gives others later. */
static void (*next_properties)(VkPhysicalDevice, Properties *), (*next_properties_2)(VkPhysicalDevice, Chain *),
    (*next_features)(VkPhysicalDevice, VkBool32 *), (*next_features_2)(VkPhysicalDevice, Features *),
    (*next_memory)(VkPhysicalDevice, Memory *), (*next_memory_2)(VkPhysicalDevice, Chain *);
static VkResult make_instance(const VkInstanceCreateInfo *info, const VkAllocationCallbacks *allocator, VkInstance *instance) {
    VkResult result = create_instance(info, allocator, instance);
    if (result != VK_SUCCESS) return result;
#define NEXT(POINTER, NAME) POINTER = (void *)next_instance_proc(*instance, "vkGetPhysicalDevice" NAME)
    NEXT(next_properties, "Properties");
    NEXT(next_properties_2, "Properties2");
    NEXT(next_features, "Features");
    NEXT(next_features_2, "Features2");
    NEXT(next_memory, "MemoryProperties");
    NEXT(next_memory_2, "MemoryProperties2");
    return VK_SUCCESS;
}

static void shrink(Properties *properties) {
    if (number("PROFILE_PUSH")) properties->limits[MAX_PUSH] = (uint32_t)number("PROFILE_PUSH");
}
static void get_properties(VkPhysicalDevice physical, Properties *properties) {
    next_properties(physical, properties);
    shrink(properties);
}
static void get_properties_2(VkPhysicalDevice physical, Chain *chain) {
    next_properties_2(physical, chain);
    shrink((Properties *)((char *)(chain + 1)));
    for (Chain *part = chain->next; part; part = part->next) {
        uint32_t *size = (uint32_t *)(part + 1) + (part->type == PROPERTIES_1_1 ? 12 : 0);
        if ((part->type == SUBGROUP || part->type == PROPERTIES_1_1) && number("PROFILE_SUBGROUP"))
            *size = (uint32_t)number("PROFILE_SUBGROUP");
    }
}

static void hide(int kind, VkBool32 *values, uint32_t count) {
    for (uint32_t place = 0; place < count; place++) values[place] &= (VkBool32)told(kind, place);
}
static void get_features(VkPhysicalDevice physical, VkBool32 *values) {
    next_features(physical, values);
    hide(0, values, FEATURES);
}
static void get_features_2(VkPhysicalDevice physical, Features *features) {
    next_features_2(physical, features);
    hide(0, features->values, FEATURES);
    for (Chain *part = features->chain.next; part; part = part->next)
        if (part->type == FEATURES_1_2) hide(FEATURES_1_2, ((Features *)part)->values, OPTIONAL_1_2);
}

static void describe(Memory *memory) {
    if (split_types()) {
        memory->type_count = split_types();
        for (uint32_t i = 0; i < memory->type_count; i++) {
            memory->types[i].flags = SPLIT[i][0];
            memory->types[i].heap = SPLIT[i][1];
        }
        memory->heap_count = 2;
        memory->heaps[1].size = memory->heaps[0].size;
        memory->heaps[1].flags = 0;
    }
    for (uint32_t i = 0; i < memory->heap_count && number("PROFILE_HEAP"); i++) memory->heaps[i].size = number("PROFILE_HEAP");
}
static void get_memory(VkPhysicalDevice physical, Memory *memory) {
    next_memory(physical, memory);
    describe(memory);
}
static void get_memory_2(VkPhysicalDevice physical, Chain *chain) {
    next_memory_2(physical, chain);
    describe((Memory *)(chain + 1));
}

/* What is allocated. */
static struct {
    VkDeviceMemory memory;
    VkDeviceSize size;
    uint32_t type;
} held[4096];
static const int HELD = sizeof held / sizeof *held;
static VkDevice the_device;

static PFN_vkVoidFunction next_of_device(const char *name) { return next_device_proc(the_device, name); }

static uint32_t heap_of(uint32_t type) { return split_types() ? SPLIT[type][1] : 0; }
static int place_of(VkDeviceMemory memory) {
    int place = 0;
    while (place < HELD && held[place].memory != memory) place++;
    if (place == HELD) abort();
    return place;
}

static VkResult allocate_memory(VkDevice device, const AllocateInfo *info, const VkAllocationCallbacks *allocator,
                                VkDeviceMemory *memory) {
    typedef VkResult (*Allocate)(VkDevice, const AllocateInfo *, const VkAllocationCallbacks *, VkDeviceMemory *);
    AllocateInfo given = *info;
    if (split_types()) given.memory_type = 0; /* the driver's only one */
    if (split_types() && info->memory_type >= split_types()) return VK_ERROR_OUT_OF_DEVICE_MEMORY;
    pthread_mutex_lock(&lock);
    VkDeviceSize sum = info->size, most = number("PROFILE_HEAP");
    for (int i = 0; i < HELD; i++)
        if (held[i].memory && heap_of(held[i].type) == heap_of(info->memory_type)) sum += held[i].size;
    VkResult result = most && sum > most ? VK_ERROR_OUT_OF_DEVICE_MEMORY
                                         : ((Allocate)next_of_device("vkAllocateMemory"))(device, &given, allocator, memory);
    if (result == VK_SUCCESS) {
        int place = place_of(0);
        held[place].memory = *memory;
        held[place].size = info->size;
        held[place].type = info->memory_type;
    }
    pthread_mutex_unlock(&lock);
    return result;
}
static void free_memory(VkDevice device, VkDeviceMemory memory, const VkAllocationCallbacks *allocator) {
    pthread_mutex_lock(&lock);
    if (memory) held[place_of(memory)].memory = 0;
    pthread_mutex_unlock(&lock);
    ((void (*)(VkDevice, VkDeviceMemory, const VkAllocationCallbacks *))next_of_device("vkFreeMemory"))(device, memory, allocator);
}
static VkResult map_memory(VkDevice device, VkDeviceMemory memory, VkDeviceSize from, VkDeviceSize size, VkMemoryMapFlags flags,
                           void **data) {
    typedef VkResult (*Map)(VkDevice, VkDeviceMemory, VkDeviceSize, VkDeviceSize, VkMemoryMapFlags, void **);
    pthread_mutex_lock(&lock);
    uint32_t type = held[place_of(memory)].type;
    pthread_mutex_unlock(&lock);
    if (split_types() && !(SPLIT[type][0] & COHERENT)) {
        fprintf(stderr, "profile: memory of type %u is mapped, and it is not coherent\n", type);
        return VK_ERROR_MEMORY_MAP_FAILED;
    }
    return ((Map)next_of_device("vkMapMemory"))(device, memory, from, size, flags, data);
}

/* Buffers may lie in any memory, images only in that of the device. */
static void place_buffer(Requirements *requirements) {
    if (split_types()) requirements->types = (1u << split_types()) - 1;
}
static void place_image(Requirements *requirements) {
    if (split_types()) requirements->types = DEVICE;
}
#define REQUIREMENTS(NAME, CALL, PLACE)                                                                                \
    static void NAME(VkDevice device, uint64_t handle, Requirements *requirements) {                                   \
        ((void (*)(VkDevice, uint64_t, Requirements *))next_of_device(CALL))(device, handle, requirements);            \
        PLACE(requirements);                                                                                           \
    }                                                                                                                  \
    static void NAME##_2(VkDevice device, const void *info, Chain *chain) {                                            \
        ((void (*)(VkDevice, const void *, Chain *))next_of_device(CALL "2"))(device, info, chain);                    \
        PLACE((Requirements *)(chain + 1));                                                                            \
    }
REQUIREMENTS(require_buffer, "vkGetBufferMemoryRequirements", place_buffer)
REQUIREMENTS(require_image, "vkGetImageMemoryRequirements", place_image)

static int asks_too_much(int kind, const VkBool32 *values, uint32_t count) {
    for (uint32_t place = 0; values && place < count; place++)
        if (values[place] && !told(kind, place)) return 1;
    return 0;
}
static VkResult create_device(VkPhysicalDevice physical, const DeviceInfo *info, const VkAllocationCallbacks *allocator,
                              VkDevice *device) {
    Link *link = next_layer(&info->chain, OF_DEVICE);
    if (!link) return VK_ERROR_INITIALIZATION_FAILED;
    int refused = asks_too_much(0, info->features, FEATURES);
    for (const Chain *part = info->chain.next; part; part = part->next) {
        const VkBool32 *values = ((const Features *)part)->values;
        if (part->type == FEATURES_2) refused |= asks_too_much(0, values, FEATURES);
        if (part->type == FEATURES_1_2) refused |= asks_too_much(FEATURES_1_2, values, OPTIONAL_1_2);
    }
    if (refused) return VK_ERROR_FEATURE_NOT_PRESENT;
    VkResult result = next_create_device(link, physical, (const VkDeviceCreateInfo *)info, allocator, device);
    if (result == VK_SUCCESS) the_device = *device;
    return result;
}

typedef struct {
    const char *name;
    PFN_vkVoidFunction call;
} Offer;
static PFN_vkVoidFunction find(const Offer *offers, const char *name) {
    for (; offers->name; offers++)
        if (!strcmp(offers->name, name)) return offers->call;
    return NULL;
}
#define OFFER(NAME, CALL) { NAME, (PFN_vkVoidFunction)CALL }

static PFN_vkVoidFunction layer_vkGetDeviceProcAddr(VkDevice device, const char *name) {
    static const Offer offers[] = {
        OFFER("vkGetDeviceProcAddr", layer_vkGetDeviceProcAddr), OFFER("vkAllocateMemory", allocate_memory),
        OFFER("vkFreeMemory", free_memory), OFFER("vkMapMemory", map_memory),
        OFFER("vkGetBufferMemoryRequirements", require_buffer), OFFER("vkGetBufferMemoryRequirements2", require_buffer_2),
        OFFER("vkGetImageMemoryRequirements", require_image), OFFER("vkGetImageMemoryRequirements2", require_image_2), { 0 }
    };
    PFN_vkVoidFunction own = find(offers, name);
    return own ? own : next_device_proc ? next_device_proc(device, name) : NULL;
}

static PFN_vkVoidFunction layer_vkGetInstanceProcAddr(VkInstance instance, const char *name) {
    static const Offer offers[] = {
        OFFER("vkGetInstanceProcAddr", layer_vkGetInstanceProcAddr), OFFER("vkGetDeviceProcAddr", layer_vkGetDeviceProcAddr),
        OFFER("vkCreateInstance", make_instance), OFFER("vkCreateDevice", create_device),
        OFFER("vkGetPhysicalDeviceProperties", get_properties), OFFER("vkGetPhysicalDeviceProperties2", get_properties_2),
        OFFER("vkGetPhysicalDeviceFeatures", get_features), OFFER("vkGetPhysicalDeviceFeatures2", get_features_2),
        OFFER("vkGetPhysicalDeviceMemoryProperties", get_memory), OFFER("vkGetPhysicalDeviceMemoryProperties2", get_memory_2), { 0 }
    };
    PFN_vkVoidFunction own = find(offers, name);
    return own ? own : next_instance_proc ? next_instance_proc(instance, name) : NULL;
}
