/* Registers and GenICam description of the producer's own modules: strings that tell what the module is, under the names
 * of the GenTL feature naming convention; and, for a camera, the description that Aravis read from it (unpacked). */
#include "producer.h"

#define REGISTER_ADDRESS G_GUINT64_CONSTANT(0x1000)
#define REGISTER_SIZE 256
#define FEATURES 6

typedef struct {
	const char *name;
	const char *value;
} Feature;

const char *port_name(ModuleKind kind)
{
	switch (kind) {
	case SYSTEM:
		return "TLPort";
	case INTERFACE:
		return "InterfacePort";
	case DEVICE:
		return "DevicePort";
	case STREAM:
		return "StreamPort";
	default:
		return "Device";
	}
}

static size_t list_features(const Module *port, Feature features[FEATURES])
{
	const Device *device = (const Device *)port;
	size_t count = 0;

	switch (port->class->kind) {
	case SYSTEM:
		features[count++] = (Feature){"TLID", PRODUCER_MODEL};
		features[count++] = (Feature){"TLVendorName", PRODUCER_VENDOR};
		features[count++] = (Feature){"TLModelName", PRODUCER_MODEL};
		features[count++] = (Feature){"TLVersion", PRODUCER_VERSION};
		features[count++] = (Feature){"TLType", TL_TYPE};
		break;
	case INTERFACE:
		features[count++] = (Feature){"InterfaceID", port->id};
		features[count++] = (Feature){"InterfaceType", TL_TYPE};
		break;
	case DEVICE:
		features[count++] = (Feature){"DeviceID", port->id};
		features[count++] = (Feature){"DeviceVendorName", device->info.vendor};
		features[count++] = (Feature){"DeviceModelName", device->info.model};
		features[count++] = (Feature){"DeviceSerialNumber", device->info.serial};
		features[count++] = (Feature){"DeviceUserID", device->info.user_name};
		features[count++] = (Feature){"DeviceType", TL_TYPE};
		break;
	case STREAM:
		features[count++] = (Feature){"StreamID", STREAM_ID};
		features[count++] = (Feature){"StreamType", TL_TYPE};
		break;
	default:
		break;
	}
	return count;
}

static char *own_description(const Module *port, size_t *size)
{
	Feature features[FEATURES];
	size_t count = list_features(port, features);
	const char *name = port_name(port->class->kind);
	unsigned int kind = port->class->kind;
	GString *xml = g_string_new("<?xml version=\"1.0\" encoding=\"utf-8\"?>\n");

	g_string_append_printf(
		xml,
		"<RegisterDescription ModelName=\"%s\" VendorName=\"PolFuse\" StandardNameSpace=\"None\""
		" SchemaMajorVersion=\"1\" SchemaMinorVersion=\"1\" SchemaSubMinorVersion=\"0\""
		" MajorVersion=\"1\" MinorVersion=\"0\" SubMinorVersion=\"0\""
		" ToolTip=\"A module of the PolFuse Lab GenTL producer\""
		" ProductGuid=\"6f1de3a4-5c0e-4d6e-9a51-0000000000%02x\""
		" VersionGuid=\"6f1de3a4-5c0e-4d6e-9a52-0000000000%02x\""
		" xmlns=\"http://www.genicam.org/GenApi/Version_1_1\""
		" xmlns:xsi=\"http://www.w3.org/2001/XMLSchema-instance\""
		" xsi:schemaLocation=\"http://www.genicam.org/GenApi/Version_1_1"
		" http://www.genicam.org/GenApi/GenApiSchema_Version_1_1.xsd\">\n"
		"<Category Name=\"Root\" NameSpace=\"Standard\">\n",
		name, kind, kind);
	for (size_t i = 0; i < count; i++)
		g_string_append_printf(xml, "<pFeature>%s</pFeature>\n", features[i].name);
	g_string_append(xml, "</Category>\n");
	for (size_t i = 0; i < count; i++)
		g_string_append_printf(xml,
				       "<StringReg Name=\"%s\" NameSpace=\"Standard\"><Address>0x%" G_GINT64_MODIFIER
				       "x</Address><Length>%d</Length><AccessMode>RO</AccessMode>"
				       "<pPort>%s</pPort></StringReg>\n",
				       features[i].name, REGISTER_ADDRESS + i * REGISTER_SIZE, REGISTER_SIZE, name);
	g_string_append_printf(xml, "<Port Name=\"%s\" NameSpace=\"Standard\"></Port>\n</RegisterDescription>\n", name);
	*size = xml->len;
	return g_string_free(xml, FALSE);
}

char *port_description(Module *port, size_t *size)
{
	if (port->class->kind != REMOTE_DEVICE)
		return own_description(port, size);
	const char *xml = arv_device_get_genicam_xml(((Device *)port->parent)->arv, size);
	if (xml == NULL)
		*size = 0;
	return g_memdup2(xml, *size);
}

gboolean copy_overlap(void *buffer, uint64_t address, size_t size, const void *source, uint64_t source_address,
		      size_t source_size)
{
	uint64_t first = MAX(address, source_address);
	uint64_t end = address + MIN(size, UINT64_MAX - address);
	uint64_t source_end = source_address + source_size;

	if (first >= MIN(end, source_end))
		return FALSE;
	memcpy((char *)buffer + (first - address), (const char *)source + (first - source_address),
	       MIN(end, source_end) - first);
	return TRUE;
}

GC_ERROR local_port_read(Module *port, uint64_t address, void *buffer, size_t size)
{
	Feature features[FEATURES];
	size_t count = list_features(port, features), length;
	gboolean any = FALSE;

	memset(buffer, 0, size);
	for (size_t i = 0; i < count; i++) {
		char value[REGISTER_SIZE] = "";
		g_strlcpy(value, features[i].value, sizeof value);
		any |= copy_overlap(buffer, address, size, value, REGISTER_ADDRESS + i * REGISTER_SIZE, sizeof value);
	}
	if (!any) {
		g_autofree char *xml = port_description(port, &length);
		any = copy_overlap(buffer, address, size, xml, XML_ADDRESS, length);
	}
	if (!any)
		return fail(GC_ERR_INVALID_ADDRESS, "%s has nothing at address 0x%" G_GINT64_MODIFIER "x",
			    port_name(port->class->kind), address);
	return GC_ERR_SUCCESS;
}
