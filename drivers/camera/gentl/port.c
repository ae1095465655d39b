/* Register access. A camera's registers are reached through Aravis (GVCP, in whole words); those of the producer's own
 * modules, and every description, are memory here. */
#include "producer.h"

/* Registers of GigE Vision are words of four bytes, big-endian, and blocks begin and end with one. */
#define WORD 4

static GC_ERROR read_camera(Device *device, uint64_t address, void *buffer, size_t size)
{
	GError *problem = NULL;
	GC_ERROR error = device_check(device);

	if (error != GC_ERR_SUCCESS)
		return error;
	if (address > UINT32_MAX || size > UINT32_MAX - address)
		return fail(GC_ERR_INVALID_ADDRESS, "address 0x%" G_GINT64_MODIFIER "x + %zu lies beyond 32 bits", address,
			    size);
	if (size == WORD && address % WORD == 0) {
		guint32 value;
		/* READREG: some cameras refuse to give single registers as memory. */
		if (!arv_device_read_register(device->arv, address, &value, &problem))
			return device_failed(device, problem, "reading a register");
		value = GUINT32_TO_BE(value);
		memcpy(buffer, &value, WORD);
		return GC_ERR_SUCCESS;
	}
	uint64_t first = address - address % WORD;
	size_t whole = (address + size - first + WORD - 1) / WORD * WORD;
	g_autofree char *words = g_try_malloc(whole);
	if (words == NULL)
		return fail(GC_ERR_INVALID_PARAMETER, "%zu bytes are more than there is memory for", size);
	if (!arv_device_read_memory(device->arv, first, (guint32)whole, words, &problem))
		return device_failed(device, problem, "reading memory");
	memcpy(buffer, words + (address - first), size);
	return GC_ERR_SUCCESS;
}

static GC_ERROR write_camera(Device *device, uint64_t address, const void *buffer, size_t size)
{
	GError *problem = NULL;
	GC_ERROR error = device_check(device);

	if (error != GC_ERR_SUCCESS)
		return error;
	if (address % WORD != 0 || size % WORD != 0 || address > UINT32_MAX || size > UINT32_MAX - address)
		return fail(GC_ERR_INVALID_ADDRESS,
			    "%zu bytes at 0x%" G_GINT64_MODIFIER "x: a camera is written in words of four bytes below 2^32",
			    size, address);
	if (size == WORD) {
		guint32 value;
		memcpy(&value, buffer, WORD);
		if (!arv_device_write_register(device->arv, address, GUINT32_FROM_BE(value), &problem))
			return device_failed(device, problem, "writing a register");
		return GC_ERR_SUCCESS;
	}
	/* Aravis takes what it only reads as not const. */
	g_autofree void *copy = g_memdup2(buffer, size);
	if (!arv_device_write_memory(device->arv, address, (guint32)size, copy, &problem))
		return device_failed(device, problem, "writing memory");
	return GC_ERR_SUCCESS;
}

static GC_ERROR read_port(Module *port, uint64_t address, void *buffer, size_t size)
{
	if (size == 0)
		return GC_ERR_SUCCESS;
	if (port->class->kind == REMOTE_DEVICE && address < XML_ADDRESS)
		return read_camera((Device *)port->parent, address, buffer, size);
	return local_port_read(port, address, buffer, size);
}

static GC_ERROR write_port(Module *port, uint64_t address, const void *buffer, size_t size)
{
	if (size == 0)
		return GC_ERR_SUCCESS;
	if (port->class->kind != REMOTE_DEVICE || address >= XML_ADDRESS)
		return fail(GC_ERR_ACCESS_DENIED, "%s is read-only at 0x%" G_GINT64_MODIFIER "x",
			    port_name(port->class->kind), address);
	return write_camera((Device *)port->parent, address, buffer, size);
}

GC_API GCReadPort(PORT_HANDLE handle, uint64_t address, void *buffer, size_t *size)
{
	FIND(Module, port, handle, PORTS);
	REQUIRE(buffer != NULL && size != NULL, "the buffer or the pointer to its size is NULL");
	return read_port(port, address, buffer, *size);
}

GC_API GCWritePort(PORT_HANDLE handle, uint64_t address, const void *buffer, size_t *size)
{
	FIND(Module, port, handle, PORTS);
	REQUIRE(buffer != NULL && size != NULL, "the buffer or the pointer to its size is NULL");
	return write_port(port, address, buffer, *size);
}

/* Stacked access stops at the first failure and tells in *count how many entries were done. */
static GC_ERROR each_entry(Module *port, PORT_REGISTER_STACK_ENTRY *entries, size_t *count, gboolean write)
{
	GC_ERROR error = GC_ERR_SUCCESS;
	size_t done = 0;

	for (; done < *count; done++) {
		PORT_REGISTER_STACK_ENTRY *entry = &entries[done];
		if (entry->pBuffer == NULL)
			error = fail(GC_ERR_INVALID_PARAMETER, "the buffer of entry %zu is NULL", done);
		else if (write)
			error = write_port(port, entry->Address, entry->pBuffer, entry->Size);
		else
			error = read_port(port, entry->Address, entry->pBuffer, entry->Size);
		if (error != GC_ERR_SUCCESS)
			break;
	}
	*count = done;
	return error;
}

GC_API GCReadPortStacked(PORT_HANDLE handle, PORT_REGISTER_STACK_ENTRY *entries, size_t *count)
{
	FIND(Module, port, handle, PORTS);
	REQUIRE(entries != NULL && count != NULL, "the entries or the pointer to their number is NULL");
	return each_entry(port, entries, count, FALSE);
}

GC_API GCWritePortStacked(PORT_HANDLE handle, PORT_REGISTER_STACK_ENTRY *entries, size_t *count)
{
	FIND(Module, port, handle, PORTS);
	REQUIRE(entries != NULL && count != NULL, "the entries or the pointer to their number is NULL");
	return each_entry(port, entries, count, TRUE);
}

static const char *module_name(ModuleKind kind)
{
	switch (kind) {
	case SYSTEM:
		return "TLSystem";
	case INTERFACE:
		return "TLInterface";
	case DEVICE:
		return "TLDevice";
	case STREAM:
		return "TLDataStream";
	default:
		return "Device";
	}
}

GC_API GCGetPortInfo(PORT_HANDLE handle, int32_t command, INFO_DATATYPE *type, void *buffer, size_t *size)
{
	FIND(Module, port, handle, PORTS);
	Reply reply = {type, buffer, size};
	gboolean remote = port->class->kind == REMOTE_DEVICE;
	const CameraInfo *camera = remote ? &((Device *)port->parent)->info : NULL;

	switch (command) {
	case PORT_INFO_ID:
		return reply_string(reply, remote ? camera->id : port->id);
	case PORT_INFO_VENDOR:
		return reply_string(reply, remote ? camera->vendor : PRODUCER_VENDOR);
	case PORT_INFO_MODEL:
		return reply_string(reply, remote ? camera->model : PRODUCER_MODEL);
	case PORT_INFO_TLTYPE:
		return reply_string(reply, TL_TYPE);
	case PORT_INFO_MODULE:
		return reply_string(reply, module_name(port->class->kind));
	case PORT_INFO_LITTLE_ENDIAN:
		return reply_bool(reply, !remote);
	case PORT_INFO_BIG_ENDIAN:
		return reply_bool(reply, remote);
	case PORT_INFO_ACCESS_READ:
		return reply_bool(reply, TRUE);
	case PORT_INFO_ACCESS_WRITE:
		return reply_bool(reply, remote);
	case PORT_INFO_ACCESS_NA:
		return reply_bool(reply, remote && device_is_lost((Device *)port->parent));
	case PORT_INFO_ACCESS_NI:
		return reply_bool(reply, FALSE);
	case PORT_INFO_VERSION:
		return reply_string(reply, remote ? camera->version : PRODUCER_VERSION);
	case PORT_INFO_PORTNAME:
		return reply_string(reply, port_name(port->class->kind));
	default:
		return reply_unknown("a port", command);
	}
}

/* "Local:NAME;ADDRESS;SIZE", address and size in hexadecimal. */
static char *description_url(Module *port, char **file, size_t *size)
{
	g_free(port_description(port, size));
	*file = g_strdup_printf("polfuse-aravis-%s.xml", port_name(port->class->kind));
	return g_strdup_printf("Local:%s;%" G_GINT64_MODIFIER "x;%zx", *file, XML_ADDRESS, *size);
}

GC_API GCGetNumPortURLs(PORT_HANDLE handle, uint32_t *count)
{
	FIND(Module, port, handle, PORTS);
	(void)port;
	REQUIRE(count != NULL, "the pointer to the count is NULL");
	*count = 1;
	return GC_ERR_SUCCESS;
}

GC_API GCGetPortURL(PORT_HANDLE handle, char *url, size_t *size)
{
	return GCGetPortURLInfo(handle, 0, URL_INFO_URL, NULL, url, size);
}

GC_API GCGetPortURLInfo(PORT_HANDLE handle, uint32_t index, int32_t command, INFO_DATATYPE *type, void *buffer,
			size_t *size)
{
	FIND(Module, port, handle, PORTS);
	Reply reply = {type, buffer, size};
	if (index != 0)
		return fail(GC_ERR_INVALID_INDEX, "URL %u of 1", index);
	size_t length;
	g_autofree char *file = NULL;
	g_autofree char *url = description_url(port, &file, &length);

	switch (command) {
	case URL_INFO_URL:
		return reply_string(reply, url);
	case URL_INFO_FILE_REGISTER_ADDRESS:
		return reply_uint64(reply, XML_ADDRESS);
	case URL_INFO_FILE_SIZE:
		return reply_uint64(reply, length);
	case URL_INFO_SCHEME:
		return reply_int32(reply, URL_SCHEME_LOCAL);
	case URL_INFO_FILENAME:
		return reply_string(reply, file);
	case URL_INFO_SCHEMA_VER_MAJOR:
	case URL_INFO_SCHEMA_VER_MINOR:
	case URL_INFO_FILE_VER_MAJOR:
	case URL_INFO_FILE_VER_MINOR:
	case URL_INFO_FILE_VER_SUBMINOR:
	case URL_INFO_FILE_SHA1_HASH:
		return fail(GC_ERR_NOT_AVAILABLE, "the description's versions and checksum stand in itself only");
	default:
		return reply_unknown("a URL", command);
	}
}
