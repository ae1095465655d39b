#include "producer.h"

gboolean device_is_lost(const Device *device)
{
	return g_atomic_int_get(device->lost) != 0;
}

static gpointer release_object(gpointer object)
{
	g_object_unref(object);
	return NULL;
}

void device_release(const Device *device, gpointer object)
{
	if (device_is_lost(device))
		g_thread_unref(g_thread_new("polfuse-release", release_object, object));
	else
		g_object_unref(object);
}

static void finalize(Module *module)
{
	Device *device = (Device *)module;

	if (device->arv != NULL)
		device_release(device, device->arv);
	g_atomic_rc_box_release(device->lost);
}

static const ModuleClass device_class = {.kind = DEVICE, .size = sizeof(Device), .finalize = finalize};
static const ModuleClass remote_class = {.kind = REMOTE_DEVICE, .size = sizeof(Module)};

/* Called in Aravis' heartbeat thread, possibly after the Device is gone: hence the flag of its own. */
static void on_lost(ArvDevice *arv, gint *lost)
{
	(void)arv;
	g_atomic_int_set(lost, 1);
}

static void release_flag(gpointer lost, GClosure *closure)
{
	(void)closure;
	g_atomic_rc_box_release(lost);
}

GC_ERROR device_check(Device *device)
{
	if (device_is_lost(device))
		return fail(GC_ERR_IO, "the camera at %s does not answer any more; close it and open it again",
			    device->info.address);
	return GC_ERR_SUCCESS;
}

GC_ERROR device_failed(Device *device, GError *error, const char *what)
{
	GC_ERROR code = GC_ERR_IO;

	if (error != NULL && error->domain == ARV_DEVICE_ERROR)
		switch (error->code) {
		case ARV_DEVICE_ERROR_TIMEOUT:
			/* Aravis gave up after several attempts: let what follows fail at once, not after seconds each. */
			g_atomic_int_set(device->lost, 1);
			break;
		case ARV_DEVICE_ERROR_PROTOCOL_ERROR_INVALID_ADDRESS:
		case ARV_DEVICE_ERROR_PROTOCOL_ERROR_BAD_ALIGNMENT:
			code = GC_ERR_INVALID_ADDRESS;
			break;
		case ARV_DEVICE_ERROR_PROTOCOL_ERROR_ACCESS_DENIED:
		case ARV_DEVICE_ERROR_PROTOCOL_ERROR_WRITE_PROTECT:
		case ARV_DEVICE_ERROR_NOT_CONTROLLER:
			code = GC_ERR_ACCESS_DENIED;
			break;
		case ARV_DEVICE_ERROR_PROTOCOL_ERROR_NOT_IMPLEMENTED:
			code = GC_ERR_NOT_IMPLEMENTED;
			break;
		case ARV_DEVICE_ERROR_PROTOCOL_ERROR_BUSY:
			code = GC_ERR_BUSY;
			break;
		case ARV_DEVICE_ERROR_PROTOCOL_ERROR_INVALID_PARAMETER:
			code = GC_ERR_INVALID_VALUE;
			break;
		default:
			break;
		}
	fail(code, "%s of the camera at %s: %s", what, device->info.address,
	     error != NULL ? error->message : "failed without a reason");
	g_clear_error(&error);
	return code;
}

static GC_ERROR connect_camera(Device *device)
{
	char local[INET_ADDRSTRLEN];
	GError *error = NULL;

	if (!local_address_towards(device->info.address, local))
		return fail(GC_ERR_IO, "there is no route to the camera at %s", device->info.address);
	g_autoptr(GInetAddress) here = g_inet_address_new_from_string(local);
	g_autoptr(GInetAddress) there = g_inet_address_new_from_string(device->info.address);
	device->arv = arv_gv_device_new(here, there, &error);
	if (device->arv == NULL)
		return device_failed(device, error, "opening");
	if (!arv_gv_device_is_controller(ARV_GV_DEVICE(device->arv)))
		return fail(GC_ERR_ACCESS_DENIED, "the camera at %s is controlled by another program",
			    device->info.address);
	/* A packet socket sees nothing on the loopback interface, where simulated cameras live. */
	if (g_inet_address_get_is_loopback(there))
		arv_gv_device_set_stream_options(ARV_GV_DEVICE(device->arv), ARV_GV_STREAM_OPTION_PACKET_SOCKET_DISABLED);
	g_signal_connect_data(device->arv, "control-lost", G_CALLBACK(on_lost), g_atomic_rc_box_acquire(device->lost),
			      release_flag, 0);
	return GC_ERR_SUCCESS;
}

GC_ERROR device_open(Interface *interface, const CameraInfo *info, void **handle)
{
	if (module_is_open(DEVICE, interface, info->id))
		return fail(GC_ERR_RESOURCE_IN_USE, "%s is open already", info->id);
	g_autoptr(Module) module = module_new(&device_class, interface, info->id);
	Device *device = (Device *)module;
	device->info = *info;
	device->lost = g_atomic_rc_box_new0(gint);
	GC_ERROR error = connect_camera(device);
	if (error == GC_ERR_SUCCESS)
		error = module_publish(device);
	if (error != GC_ERR_SUCCESS)
		return error;
	g_autoptr(Module) remote = module_new(&remote_class, device, NULL);
	error = module_publish(remote);
	if (error != GC_ERR_SUCCESS) {
		module_close(device);
		return error;
	}
	device->remote = remote->handle;
	*handle = module->handle;
	return GC_ERR_SUCCESS;
}

GC_ERROR camera_info_reply(const CameraInfo *info, int32_t access, int32_t command, Reply reply)
{
	switch (command) {
	case DEVICE_INFO_ID:
		return reply_string(reply, info->id);
	case DEVICE_INFO_VENDOR:
		return reply_string(reply, info->vendor);
	case DEVICE_INFO_MODEL:
		return reply_string(reply, info->model);
	case DEVICE_INFO_TLTYPE:
		return reply_string(reply, TL_TYPE);
	case DEVICE_INFO_DISPLAYNAME: {
		g_autofree char *name = g_strdup_printf("%s %s (%s)", info->vendor, info->model, info->address);
		return reply_string(reply, name);
	}
	case DEVICE_INFO_ACCESS_STATUS:
		return reply_int32(reply, access);
	case DEVICE_INFO_USER_DEFINED_NAME:
		return reply_string(reply, info->user_name);
	case DEVICE_INFO_SERIAL_NUMBER:
		return reply_string(reply, info->serial);
	case DEVICE_INFO_VERSION:
		return reply_string(reply, info->version);
	case DEVICE_INFO_TIMESTAMP_FREQUENCY:
		return reply_uint64(reply, NANOSECONDS_PER_SECOND); /* Aravis gives stamps in nanoseconds */
	default:
		return reply_unknown("a camera", command);
	}
}

GC_API DevClose(DEV_HANDLE handle)
{
	return handle_close(handle, DEVICE);
}

GC_API DevGetPort(DEV_HANDLE handle, PORT_HANDLE *port)
{
	FIND(Device, device, handle, DEVICE);
	REQUIRE(port != NULL, "the pointer to the handle is NULL");
	*port = device->remote;
	return GC_ERR_SUCCESS;
}

GC_API DevGetInfo(DEV_HANDLE handle, int32_t command, INFO_DATATYPE *type, void *buffer, size_t *size)
{
	FIND(Device, device, handle, DEVICE);
	int32_t access = device_is_lost(device) ? DEVICE_ACCESS_STATUS_NOACCESS : DEVICE_ACCESS_STATUS_OPEN_READWRITE;
	return camera_info_reply(&device->info, access, command, (Reply){type, buffer, size});
}

GC_API DevGetParentIF(DEV_HANDLE handle, IF_HANDLE *interface)
{
	FIND(Device, device, handle, DEVICE);
	REQUIRE(interface != NULL, "the pointer to the handle is NULL");
	*interface = device->module.parent->handle;
	return GC_ERR_SUCCESS;
}

GC_API DevGetNumDataStreams(DEV_HANDLE handle, uint32_t *count)
{
	FIND(Device, device, handle, DEVICE);
	(void)device;
	REQUIRE(count != NULL, "the pointer to the count is NULL");
	*count = 1;
	return GC_ERR_SUCCESS;
}

GC_API DevGetDataStreamID(DEV_HANDLE handle, uint32_t index, char *id, size_t *size)
{
	FIND(Device, device, handle, DEVICE);
	(void)device;
	if (index != 0)
		return fail(GC_ERR_INVALID_INDEX, "stream %u of 1", index);
	return reply_string((Reply){NULL, id, size}, STREAM_ID);
}

GC_API DevOpenDataStream(DEV_HANDLE handle, const char *id, DS_HANDLE *stream)
{
	FIND(Device, device, handle, DEVICE);
	REQUIRE(id != NULL && stream != NULL, "the stream's id or the pointer to its handle is NULL");
	if (strcmp(id, STREAM_ID) != 0)
		return fail(GC_ERR_INVALID_ID, "no stream '%s', only '" STREAM_ID "'", id);
	return stream_open(device, stream);
}
