/* A Vulkan layer that makes calls fail, to test what a program does then.
 *
 * It counts the calls that can fail, in the order in which they are made.
 *   FAULT_COUNT=FILE   adds their names to FILE, a line each
 *   FAULT_AT=N         makes call N (from 0) fail, by not making it
 *   FAULT_LEAK=N       loses N bytes with each submission
 *   FAULT_RESULT=R     what it answers then (a VkResult; VK_TIMEOUT or VK_ERROR_DEVICE_LOST for a wait)
 * A failed wait is a wait that was not made: the queue is still at work, as after a real timeout.
 */
#include "layer.h"

/* What these structures hold is passed on unread. */
typedef void VkMemoryAllocateInfo, VkBufferCreateInfo, VkImageCreateInfo, VkImageViewCreateInfo,
    VkSamplerCreateInfo, VkFenceCreateInfo, VkSemaphoreCreateInfo, VkQueryPoolCreateInfo, VkCommandPoolCreateInfo,
    VkCommandBufferAllocateInfo, VkCommandBufferBeginInfo, VkDescriptorSetLayoutCreateInfo, VkPipelineLayoutCreateInfo,
    VkShaderModuleCreateInfo, VkPipelineCacheCreateInfo, VkComputePipelineCreateInfo, VkDescriptorPoolCreateInfo,
    VkDescriptorSetAllocateInfo, VkSubmitInfo2, VkSwapchainCreateInfoKHR, VkPresentInfoKHR;

static long count;
void *lost; /* what FAULT_LEAK lost last: seen from outside, so that compilers keep it */

static void note(const char *name) {
    const char *file = getenv("FAULT_COUNT");
    if (!file) return;
    FILE *out = fopen(file, "a");
    if (out) {
        fprintf(out, "%s\n", name);
        fclose(out);
    }
}

/* Says whether this call is the one that fails. */
static int fails(const char *name) {
    pthread_mutex_lock(&lock);
    const char *at = getenv("FAULT_AT");
    long here = count++;
    note(name);
    const char *leak = getenv("FAULT_LEAK");
    if (leak && !strcmp(name, "vkQueueSubmit2")) lost = memset(malloc(atol(leak)), 1, atol(leak));
    pthread_mutex_unlock(&lock);
    return at && atol(at) == here;
}

static VkResult answer(VkResult usual) {
    const char *given = getenv("FAULT_RESULT");
    return given ? (VkResult)atoi(given) : usual;
}

/* Every call that returns a VkResult and whose failure must be survived: name, usual answer, parameters, arguments. */
#define CALLS(X)                                                                                                       \
    X(AllocateMemory, VK_ERROR_OUT_OF_DEVICE_MEMORY,                                                                   \
      (VkDevice d, const VkMemoryAllocateInfo *i, const VkAllocationCallbacks *a, VkDeviceMemory *o), (d, i, a, o))    \
    X(MapMemory, VK_ERROR_MEMORY_MAP_FAILED,                                                                           \
      (VkDevice d, VkDeviceMemory m, VkDeviceSize s, VkDeviceSize z, VkMemoryMapFlags f, void **o), (d, m, s, z, f, o))\
    X(CreateBuffer, VK_ERROR_OUT_OF_HOST_MEMORY,                                                                       \
      (VkDevice d, const VkBufferCreateInfo *i, const VkAllocationCallbacks *a, VkBuffer *o), (d, i, a, o))            \
    X(BindBufferMemory, VK_ERROR_OUT_OF_DEVICE_MEMORY,                                                                 \
      (VkDevice d, VkBuffer b, VkDeviceMemory m, VkDeviceSize s), (d, b, m, s))                                        \
    X(CreateImage, VK_ERROR_OUT_OF_DEVICE_MEMORY,                                                                      \
      (VkDevice d, const VkImageCreateInfo *i, const VkAllocationCallbacks *a, VkImage *o), (d, i, a, o))              \
    X(BindImageMemory, VK_ERROR_OUT_OF_DEVICE_MEMORY,                                                                  \
      (VkDevice d, VkImage b, VkDeviceMemory m, VkDeviceSize s), (d, b, m, s))                                         \
    X(CreateImageView, VK_ERROR_OUT_OF_HOST_MEMORY,                                                                    \
      (VkDevice d, const VkImageViewCreateInfo *i, const VkAllocationCallbacks *a, VkImageView *o), (d, i, a, o))      \
    X(CreateSampler, VK_ERROR_OUT_OF_HOST_MEMORY,                                                                      \
      (VkDevice d, const VkSamplerCreateInfo *i, const VkAllocationCallbacks *a, VkSampler *o), (d, i, a, o))          \
    X(CreateFence, VK_ERROR_OUT_OF_HOST_MEMORY,                                                                        \
      (VkDevice d, const VkFenceCreateInfo *i, const VkAllocationCallbacks *a, VkFence *o), (d, i, a, o))              \
    X(CreateSemaphore, VK_ERROR_OUT_OF_HOST_MEMORY,                                                                    \
      (VkDevice d, const VkSemaphoreCreateInfo *i, const VkAllocationCallbacks *a, VkSemaphore *o), (d, i, a, o))      \
    X(CreateQueryPool, VK_ERROR_OUT_OF_HOST_MEMORY,                                                                    \
      (VkDevice d, const VkQueryPoolCreateInfo *i, const VkAllocationCallbacks *a, VkQueryPool *o), (d, i, a, o))      \
    X(CreateCommandPool, VK_ERROR_OUT_OF_HOST_MEMORY,                                                                  \
      (VkDevice d, const VkCommandPoolCreateInfo *i, const VkAllocationCallbacks *a, VkCommandPool *o), (d, i, a, o))  \
    X(AllocateCommandBuffers, VK_ERROR_OUT_OF_HOST_MEMORY,                                                             \
      (VkDevice d, const VkCommandBufferAllocateInfo *i, VkCommandBuffer *o), (d, i, o))                               \
    X(ResetCommandPool, VK_ERROR_OUT_OF_DEVICE_MEMORY, (VkDevice d, VkCommandPool p, VkCommandPoolResetFlags f),       \
      (d, p, f))                                                                                                       \
    X(BeginCommandBuffer, VK_ERROR_OUT_OF_HOST_MEMORY, (VkCommandBuffer c, const VkCommandBufferBeginInfo *i), (c, i)) \
    X(EndCommandBuffer, VK_ERROR_OUT_OF_HOST_MEMORY, (VkCommandBuffer c), (c))                                         \
    X(CreateDescriptorSetLayout, VK_ERROR_OUT_OF_HOST_MEMORY,                                                          \
      (VkDevice d, const VkDescriptorSetLayoutCreateInfo *i, const VkAllocationCallbacks *a,                           \
       VkDescriptorSetLayout *o), (d, i, a, o))                                                                        \
    X(CreatePipelineLayout, VK_ERROR_OUT_OF_HOST_MEMORY,                                                               \
      (VkDevice d, const VkPipelineLayoutCreateInfo *i, const VkAllocationCallbacks *a, VkPipelineLayout *o),          \
      (d, i, a, o))                                                                                                    \
    X(CreateShaderModule, VK_ERROR_OUT_OF_HOST_MEMORY,                                                                 \
      (VkDevice d, const VkShaderModuleCreateInfo *i, const VkAllocationCallbacks *a, VkShaderModule *o), (d, i, a, o))\
    X(CreatePipelineCache, VK_ERROR_OUT_OF_HOST_MEMORY,                                                                \
      (VkDevice d, const VkPipelineCacheCreateInfo *i, const VkAllocationCallbacks *a, VkPipelineCache *o),            \
      (d, i, a, o))                                                                                                    \
    X(GetPipelineCacheData, VK_ERROR_OUT_OF_HOST_MEMORY, (VkDevice d, VkPipelineCache c, size_t *s, void *o),          \
      (d, c, s, o))                                                                                                    \
    X(CreateComputePipelines, VK_ERROR_OUT_OF_DEVICE_MEMORY,                                                           \
      (VkDevice d, VkPipelineCache c, uint32_t n, const VkComputePipelineCreateInfo *i,                                \
       const VkAllocationCallbacks *a, VkPipeline *o), (d, c, n, i, a, o))                                             \
    X(CreateDescriptorPool, VK_ERROR_OUT_OF_HOST_MEMORY,                                                               \
      (VkDevice d, const VkDescriptorPoolCreateInfo *i, const VkAllocationCallbacks *a, VkDescriptorPool *o),          \
      (d, i, a, o))                                                                                                    \
    X(ResetDescriptorPool, VK_ERROR_OUT_OF_HOST_MEMORY,                                                                \
      (VkDevice d, VkDescriptorPool p, VkDescriptorPoolResetFlags f), (d, p, f))                                       \
    X(AllocateDescriptorSets, VK_ERROR_OUT_OF_POOL_MEMORY,                                                             \
      (VkDevice d, const VkDescriptorSetAllocateInfo *i, VkDescriptorSet *o), (d, i, o))                               \
    X(ResetFences, VK_ERROR_OUT_OF_DEVICE_MEMORY, (VkDevice d, uint32_t n, const VkFence *f), (d, n, f))               \
    X(WaitForFences, VK_TIMEOUT, (VkDevice d, uint32_t n, const VkFence *f, VkBool32 all, uint64_t t),                 \
      (d, n, f, all, t))                                                                                               \
    X(GetQueryPoolResults, VK_ERROR_DEVICE_LOST,                                                                       \
      (VkDevice d, VkQueryPool p, uint32_t b, uint32_t n, size_t s, void *o, VkDeviceSize t, VkQueryResultFlags f),    \
      (d, p, b, n, s, o, t, f))                                                                                        \
    X(QueueSubmit2, VK_ERROR_DEVICE_LOST, (VkQueue q, uint32_t n, const VkSubmitInfo2 *i, VkFence f), (q, n, i, f))    \
    X(QueueWaitIdle, VK_ERROR_DEVICE_LOST, (VkQueue q), (q))                                                           \
    X(DeviceWaitIdle, VK_ERROR_DEVICE_LOST, (VkDevice d), (d))                                                         \
    X(CreateSwapchainKHR, VK_ERROR_OUT_OF_DEVICE_MEMORY,                                                               \
      (VkDevice d, const VkSwapchainCreateInfoKHR *i, const VkAllocationCallbacks *a, VkSwapchainKHR *o), (d, i, a, o))\
    X(AcquireNextImageKHR, VK_ERROR_DEVICE_LOST,                                                                       \
      (VkDevice d, VkSwapchainKHR s, uint64_t t, VkSemaphore m, VkFence f, uint32_t *o), (d, s, t, m, f, o))           \
    X(QueuePresentKHR, VK_ERROR_DEVICE_LOST, (VkQueue q, const VkPresentInfoKHR *i), (q, i))

#define DEFINE(NAME, USUAL, PARAMETERS, ARGUMENTS)                                                                     \
    static VkResult(*next_##NAME) PARAMETERS;                                                                                   \
    static VkResult fault_##NAME PARAMETERS {                                                    \
        if (fails("vk" #NAME)) return answer(USUAL);                                                                   \
        return next_##NAME ARGUMENTS;                                                                                  \
    }
CALLS(DEFINE)

static VkResult create_device(VkPhysicalDevice physical, const VkDeviceCreateInfo *info,
                              const VkAllocationCallbacks *allocator, VkDevice *device) {
    Link *link = next_layer(info->next, OF_DEVICE);
    if (!link || fails("vkCreateDevice")) return answer(VK_ERROR_INITIALIZATION_FAILED);
    VkResult result = next_create_device(link, physical, info, allocator, device);
    if (result != VK_SUCCESS) return result;
#define FIND(NAME, USUAL, PARAMETERS, ARGUMENTS)                                                                       \
    next_##NAME = (VkResult(*) PARAMETERS)next_device_proc(*device, "vk" #NAME);
    CALLS(FIND)
    return VK_SUCCESS;
}

static PFN_vkVoidFunction layer_vkGetDeviceProcAddr(VkDevice device, const char *name) {
#define OFFER(NAME, USUAL, PARAMETERS, ARGUMENTS)                                                                      \
    if (!strcmp(name, "vk" #NAME)) return next_##NAME ? (PFN_vkVoidFunction)fault_##NAME : NULL;
    if (!strcmp(name, "vkGetDeviceProcAddr")) return (PFN_vkVoidFunction)layer_vkGetDeviceProcAddr;
    CALLS(OFFER)
    return next_device_proc ? next_device_proc(device, name) : NULL;
}

static PFN_vkVoidFunction layer_vkGetInstanceProcAddr(VkInstance instance, const char *name) {
    if (!strcmp(name, "vkGetInstanceProcAddr")) return (PFN_vkVoidFunction)layer_vkGetInstanceProcAddr;
    if (!strcmp(name, "vkCreateInstance")) return (PFN_vkVoidFunction)create_instance;
    if (!strcmp(name, "vkCreateDevice")) return (PFN_vkVoidFunction)create_device;
    if (!strcmp(name, "vkGetDeviceProcAddr")) return (PFN_vkVoidFunction)layer_vkGetDeviceProcAddr;
    return next_instance_proc ? next_instance_proc(instance, name) : NULL;
}
