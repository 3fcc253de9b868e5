/* What the layers of the tests share: as much of Vulkan's headers as they need, and their place in the loader's chain. */
#pragma once
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>
#include <stdint.h>

#define EXPORT __attribute__((visibility("default")))

typedef int32_t VkResult;
typedef uint32_t VkBool32, VkMemoryMapFlags, VkCommandPoolResetFlags, VkDescriptorPoolResetFlags, VkQueryResultFlags;
typedef uint64_t VkDeviceSize;
typedef struct VkInstance_T *VkInstance;
typedef struct VkPhysicalDevice_T *VkPhysicalDevice;
typedef struct VkDevice_T *VkDevice;
typedef struct VkQueue_T *VkQueue;
typedef struct VkCommandBuffer_T *VkCommandBuffer;
typedef uint64_t VkDeviceMemory, VkBuffer, VkImage, VkImageView, VkSampler, VkFence, VkSemaphore, VkQueryPool, VkCommandPool,
    VkDescriptorSetLayout, VkPipelineLayout, VkShaderModule, VkPipelineCache, VkPipeline, VkDescriptorPool, VkDescriptorSet,
    VkSwapchainKHR;
typedef void VkAllocationCallbacks;
typedef void (*PFN_vkVoidFunction)(void);
typedef PFN_vkVoidFunction (*PFN_vkGetInstanceProcAddr)(VkInstance, const char *);
typedef PFN_vkVoidFunction (*PFN_vkGetDeviceProcAddr)(VkDevice, const char *);
enum {
    VK_SUCCESS = 0,
    VK_TIMEOUT = 2,
    VK_ERROR_OUT_OF_HOST_MEMORY = -1,
    VK_ERROR_OUT_OF_DEVICE_MEMORY = -2,
    VK_ERROR_INITIALIZATION_FAILED = -3,
    VK_ERROR_DEVICE_LOST = -4,
    VK_ERROR_MEMORY_MAP_FAILED = -5,
    VK_ERROR_FEATURE_NOT_PRESENT = -8,
    VK_ERROR_OUT_OF_POOL_MEMORY = -1000069000,
};

/* The beginning of each structure in a chain, and what the loader puts into the chains of the two creations. */
typedef struct Chain {
    int32_t type;
    struct Chain *next;
} Chain;
typedef struct {
    int32_t type;
    const Chain *next;
} VkInstanceCreateInfo, VkDeviceCreateInfo;
typedef struct Link {
    struct Link *next;
    PFN_vkGetInstanceProcAddr instance_proc;
    void (*other_proc)(void); /* of physical devices, or of devices */
} Link;
typedef struct {
    Chain chain;
    int32_t function; /* 0 is the link to the next layer */
    Link *link;
} LoaderInfo;
enum { OF_INSTANCE = 47, OF_DEVICE = 48 };

typedef struct {
    int32_t type;
    void *next;
    uint32_t version;
    PFN_vkGetInstanceProcAddr instance_proc;
    PFN_vkGetDeviceProcAddr device_proc;
    PFN_vkGetInstanceProcAddr physical_device_proc;
} Negotiation;

/* The next layer, which is taken out of the chain. */
static Link *next_layer(const Chain *chain, int32_t type) {
    for (; chain; chain = chain->next) {
        LoaderInfo *info = (LoaderInfo *)chain;
        if (chain->type == type && info->function == 0) {
            Link *link = info->link;
            info->link = link->next;
            return link;
        }
    }
    return NULL;
}

static PFN_vkGetInstanceProcAddr next_instance_proc;
static PFN_vkGetDeviceProcAddr next_device_proc;
static VkInstance the_instance;
static pthread_mutex_t lock = PTHREAD_MUTEX_INITIALIZER;

/* Makes the instance by the next layer. */
static VkResult create_instance(const VkInstanceCreateInfo *info, const VkAllocationCallbacks *allocator,
                                VkInstance *instance) {
    typedef VkResult (*Create)(const VkInstanceCreateInfo *, const VkAllocationCallbacks *, VkInstance *);
    Link *link = next_layer(info->next, OF_INSTANCE);
    if (!link) return VK_ERROR_INITIALIZATION_FAILED;
    next_instance_proc = link->instance_proc;
    VkResult result = ((Create)next_instance_proc(NULL, "vkCreateInstance"))(info, allocator, instance);
    if (result == VK_SUCCESS) the_instance = *instance;
    return result;
}

/* Makes the device by the next layer. */
static VkResult next_create_device(Link *link, VkPhysicalDevice physical, const VkDeviceCreateInfo *info,
                                   const VkAllocationCallbacks *allocator, VkDevice *device) {
    typedef VkResult (*Create)(VkPhysicalDevice, const VkDeviceCreateInfo *, const VkAllocationCallbacks *, VkDevice *);
    next_device_proc = (PFN_vkGetDeviceProcAddr)link->other_proc;
    return ((Create)link->instance_proc(the_instance, "vkCreateDevice"))(physical, info, allocator, device);
}

/* What each layer defines. */
static PFN_vkVoidFunction layer_vkGetInstanceProcAddr(VkInstance instance, const char *name);
static PFN_vkVoidFunction layer_vkGetDeviceProcAddr(VkDevice device, const char *name);

EXPORT VkResult vkNegotiateLoaderLayerInterfaceVersion(Negotiation *loader) {
    if (loader->version < 2) return VK_ERROR_INITIALIZATION_FAILED;
    loader->version = 2;
    loader->instance_proc = layer_vkGetInstanceProcAddr;
    loader->device_proc = layer_vkGetDeviceProcAddr;
    loader->physical_device_proc = NULL;
    return VK_SUCCESS;
}
