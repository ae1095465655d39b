#include "producer.h"

InterfaceInfo *interface_info_copy(const InterfaceInfo *info)
{
	InterfaceInfo *copy = g_new0(InterfaceInfo, 1);

	copy->id = g_strdup(info->id);
	copy->display_name = g_strdup(info->display_name);
	copy->broadcast = info->broadcast;
	copy->local = info->local;
	copy->targets = g_array_ref(info->targets); /* never changed once made */
	return copy;
}

void interface_info_free(InterfaceInfo *info)
{
	g_free(info->id);
	g_free(info->display_name);
	g_array_unref(info->targets);
	g_free(info);
}

GC_ERROR interface_info_reply(const InterfaceInfo *info, int32_t command, Reply reply)
{
	switch (command) {
	case INTERFACE_INFO_ID:
		return reply_string(reply, info->id);
	case INTERFACE_INFO_DISPLAYNAME:
		return reply_string(reply, info->display_name);
	case INTERFACE_INFO_TLTYPE:
		return reply_string(reply, TL_TYPE);
	default:
		return reply_unknown("an interface", command);
	}
}

static void finalize(Module *module)
{
	Interface *interface = (Interface *)module;

	interface_info_free(interface->info);
	g_ptr_array_unref(interface->cameras);
	g_mutex_clear(&interface->lock);
}

static const ModuleClass interface_class = {.kind = INTERFACE, .size = sizeof(Interface), .finalize = finalize};

GC_ERROR interface_open(System *system, const InterfaceInfo *info, void **handle)
{
	g_autoptr(Module) module = module_new(&interface_class, system, info->id);
	Interface *interface = (Interface *)module;

	interface->info = interface_info_copy(info);
	interface->cameras = g_ptr_array_new_with_free_func(g_free);
	g_mutex_init(&interface->lock);
	GC_ERROR error = module_publish(interface);
	if (error == GC_ERR_SUCCESS)
		*handle = module->handle;
	return error;
}

GC_API IFClose(IF_HANDLE handle)
{
	return handle_close(handle, INTERFACE);
}

GC_API IFGetInfo(IF_HANDLE handle, int32_t command, INFO_DATATYPE *type, void *buffer, size_t *size)
{
	FIND(Interface, interface, handle, INTERFACE);
	return interface_info_reply(interface->info, command, (Reply){type, buffer, size});
}

GC_API IFGetParentTL(IF_HANDLE handle, TL_HANDLE *system)
{
	FIND(Interface, interface, handle, INTERFACE);
	REQUIRE(system != NULL, "the pointer to the handle is NULL");
	*system = interface->module.parent->handle;
	return GC_ERR_SUCCESS;
}

static gboolean same_cameras(const GPtrArray *one, const GPtrArray *other)
{
	gboolean same = one->len == other->len;

	for (guint i = 0; same && i < one->len; i++)
		same = memcmp(one->pdata[i], other->pdata[i], sizeof(CameraInfo)) == 0;
	return same;
}

GC_API IFUpdateDeviceList(IF_HANDLE handle, bool8_t *changed, uint64_t timeout_ms)
{
	FIND(Interface, interface, handle, INTERFACE);
	const InterfaceInfo *info = interface->info;
	GC_ERROR error = GC_ERR_SUCCESS;

	GPtrArray *found = discover_cameras(info->local, info->targets, info->broadcast, timeout_ms, &error);
	if (found == NULL)
		return error;
	g_mutex_lock(&interface->lock);
	if (changed != NULL)
		*changed = !same_cameras(found, interface->cameras);
	GPtrArray *old = interface->cameras;
	interface->cameras = found;
	g_mutex_unlock(&interface->lock);
	g_ptr_array_unref(old);
	return GC_ERR_SUCCESS;
}

GC_API IFGetNumDevices(IF_HANDLE handle, uint32_t *count)
{
	FIND(Interface, interface, handle, INTERFACE);
	REQUIRE(count != NULL, "the pointer to the count is NULL");
	g_mutex_lock(&interface->lock);
	*count = interface->cameras->len;
	g_mutex_unlock(&interface->lock);
	return GC_ERR_SUCCESS;
}

GC_API IFGetDeviceID(IF_HANDLE handle, uint32_t index, char *id, size_t *size)
{
	FIND(Interface, interface, handle, INTERFACE);
	CameraInfo camera = {0};

	g_mutex_lock(&interface->lock);
	guint count = interface->cameras->len;
	if (index < count)
		camera = *(CameraInfo *)interface->cameras->pdata[index];
	g_mutex_unlock(&interface->lock);
	if (index >= count)
		return fail(GC_ERR_INVALID_INDEX, "camera %u of %u", index, count);
	return reply_string((Reply){NULL, id, size}, camera.id);
}

static GC_ERROR find_camera(Interface *interface, const char *id, CameraInfo *camera)
{
	gboolean found = FALSE;

	g_mutex_lock(&interface->lock);
	for (guint i = 0; !found && i < interface->cameras->len; i++) {
		*camera = *(CameraInfo *)interface->cameras->pdata[i];
		found = strcmp(camera->id, id) == 0;
	}
	g_mutex_unlock(&interface->lock);
	if (!found)
		return fail(GC_ERR_INVALID_ID, "no camera '%s' since the list was last updated", id);
	return GC_ERR_SUCCESS;
}

GC_API IFGetDeviceInfo(IF_HANDLE handle, const char *id, int32_t command, INFO_DATATYPE *type, void *buffer,
		       size_t *size)
{
	FIND(Interface, interface, handle, INTERFACE);
	REQUIRE(id != NULL, "the camera's id is NULL");
	CameraInfo camera;
	GC_ERROR error = find_camera(interface, id, &camera);
	if (error != GC_ERR_SUCCESS)
		return error;
	int32_t access = module_is_open(DEVICE, interface, id) ? DEVICE_ACCESS_STATUS_OPEN_READWRITE : camera.access;
	return camera_info_reply(&camera, access, command, (Reply){type, buffer, size});
}

GC_API IFOpenDevice(IF_HANDLE handle, const char *id, int32_t access, DEV_HANDLE *device)
{
	FIND(Interface, interface, handle, INTERFACE);
	REQUIRE(id != NULL && device != NULL, "the camera's id or the pointer to its handle is NULL");
	CameraInfo camera;
	GC_ERROR error = find_camera(interface, id, &camera);
	if (error != GC_ERR_SUCCESS)
		return error;
	if (access == DEVICE_ACCESS_READONLY)
		return fail(GC_ERR_NOT_IMPLEMENTED, "%s: cameras are opened for control only, not for reading alone", id);
	REQUIRE(access == DEVICE_ACCESS_CONTROL || access == DEVICE_ACCESS_EXCLUSIVE, "unknown kind of access");
	return device_open(interface, &camera, device);
}
