/* The transport layer itself: one system, whose interfaces are either the addresses listed in POLFUSE_GENTL_CAMERAS, asked
 * one by one, or the machine's network interfaces (those named in POLFUSE_GENTL_INTERFACE, else all), asked by
 * broadcast. */
#include <ifaddrs.h>
#include <net/if.h>

#include "producer.h"

#define CAMERAS_VARIABLE "POLFUSE_GENTL_CAMERAS"
#define INTERFACE_VARIABLE "POLFUSE_GENTL_INTERFACE"

static void finalize(Module *module)
{
	System *system = (System *)module;

	g_ptr_array_unref(system->interfaces);
	g_mutex_clear(&system->lock);
}

static const ModuleClass system_class = {.kind = SYSTEM, .size = sizeof(System), .finalize = finalize};

static GC_ERROR info(int32_t command, Reply reply)
{
	g_autofree char *path = library_path();
	g_autofree char *name = g_path_get_basename(path);

	switch (command) {
	case TL_INFO_ID:
	case TL_INFO_NAME:
		return reply_string(reply, name);
	case TL_INFO_VENDOR:
		return reply_string(reply, PRODUCER_VENDOR);
	case TL_INFO_MODEL:
		return reply_string(reply, PRODUCER_MODEL);
	case TL_INFO_VERSION:
		return reply_string(reply, PRODUCER_VERSION);
	case TL_INFO_TLTYPE:
		return reply_string(reply, TL_TYPE);
	case TL_INFO_PATHNAME:
		return reply_string(reply, path);
	case TL_INFO_DISPLAYNAME:
		return reply_string(reply, "GigE Vision through Aravis");
	case TL_INFO_CHAR_ENCODING:
		return reply_int32(reply, TL_CHAR_ENCODING_ASCII);
	case TL_INFO_GENTL_VER_MAJOR:
		return reply_uint32(reply, GENTL_MAJOR);
	case TL_INFO_GENTL_VER_MINOR:
		return reply_uint32(reply, GENTL_MINOR);
	default:
		return reply_unknown("the system", command);
	}
}

GC_API GCGetInfo(int32_t command, INFO_DATATYPE *type, void *buffer, size_t *size)
{
	return info(command, (Reply){type, buffer, size});
}

GC_API TLGetInfo(TL_HANDLE handle, int32_t command, INFO_DATATYPE *type, void *buffer, size_t *size)
{
	FIND(System, system, handle, SYSTEM);
	(void)system;
	return info(command, (Reply){type, buffer, size});
}

GC_API TLOpen(TL_HANDLE *handle)
{
	REQUIRE(handle != NULL, "the pointer to the handle is NULL");
	if (!library_is_ready())
		return fail(GC_ERR_NOT_INITIALIZED, "call GCInitLib first");
	g_autoptr(Module) module = module_new(&system_class, NULL, "system");
	System *system = (System *)module;
	g_mutex_init(&system->lock);
	system->interfaces = g_ptr_array_new_with_free_func((GDestroyNotify)interface_info_free);
	GC_ERROR error = module_publish(system);
	if (error == GC_ERR_SUCCESS)
		*handle = module->handle;
	return error;
}

GC_API TLClose(TL_HANDLE handle)
{
	return handle_close(handle, SYSTEM);
}

/* Cameras asked by address. NULL where the variable is unset; *error where it holds what is no address. */
static InterfaceInfo *listed_cameras(GC_ERROR *error)
{
	const char *value = g_getenv(CAMERAS_VARIABLE);

	if (value == NULL || *value == '\0')
		return NULL;
	InterfaceInfo *found = g_new0(InterfaceInfo, 1);
	found->id = g_strdup("addresses");
	found->display_name = g_strdup_printf("addresses %s", value);
	found->targets = g_array_new(FALSE, FALSE, sizeof(struct in_addr));
	g_auto(GStrv) words = g_strsplit_set(value, ", ", -1);
	for (char **word = words; *word != NULL; word++) {
		struct in_addr address;
		if (**word == '\0')
			continue;
		if (inet_pton(AF_INET, *word, &address) != 1) {
			*error = fail(GC_ERR_INVALID_VALUE,
				      CAMERAS_VARIABLE ": found '%s', expected IPv4 addresses with commas between", *word);
			interface_info_free(found);
			return NULL;
		}
		g_array_append_val(found->targets, address);
	}
	return found;
}

/* Whether an interface is one of those named in the variable; all are where it is unset. */
static gboolean is_wanted(const char *name)
{
	const char *value = g_getenv(INTERFACE_VARIABLE);

	if (value == NULL || *value == '\0')
		return TRUE;
	g_auto(GStrv) words = g_strsplit_set(value, ", ", -1);
	return g_strv_contains((const char *const *)words, name);
}

static void add_network_interfaces(GPtrArray *found)
{
	struct ifaddrs *all = NULL;

	if (getifaddrs(&all) != 0)
		return;
	for (struct ifaddrs *one = all; one != NULL; one = one->ifa_next) {
		unsigned int needed = IFF_UP | IFF_BROADCAST;
		char address[INET_ADDRSTRLEN];
		if (one->ifa_addr == NULL || one->ifa_addr->sa_family != AF_INET || (one->ifa_flags & needed) != needed ||
		    (one->ifa_flags & IFF_LOOPBACK) || one->ifa_broadaddr == NULL || !is_wanted(one->ifa_name))
			continue;
		InterfaceInfo *entry = g_new0(InterfaceInfo, 1);
		entry->local = ((struct sockaddr_in *)(void *)one->ifa_addr)->sin_addr;
		entry->broadcast = TRUE;
		entry->targets = g_array_new(FALSE, FALSE, sizeof(struct in_addr));
		g_array_append_val(entry->targets, ((struct sockaddr_in *)(void *)one->ifa_broadaddr)->sin_addr);
		inet_ntop(AF_INET, &entry->local, address, sizeof address);
		entry->id = g_strdup_printf("%s-%s", one->ifa_name, address);
		entry->display_name = g_strdup_printf("%s (%s)", one->ifa_name, address);
		g_ptr_array_add(found, entry);
	}
	freeifaddrs(all);
}

static gboolean same_interfaces(const GPtrArray *one, const GPtrArray *other)
{
	gboolean same = one->len == other->len;

	for (guint i = 0; same && i < one->len; i++) {
		const InterfaceInfo *a = one->pdata[i], *b = other->pdata[i];
		same = strcmp(a->id, b->id) == 0 && strcmp(a->display_name, b->display_name) == 0;
	}
	return same;
}

GC_API TLUpdateInterfaceList(TL_HANDLE handle, bool8_t *changed, uint64_t timeout_ms)
{
	FIND(System, system, handle, SYSTEM);
	GC_ERROR error = GC_ERR_SUCCESS;
	(void)timeout_ms; /* nothing to wait for */

	g_autoptr(GPtrArray) found = g_ptr_array_new_with_free_func((GDestroyNotify)interface_info_free);
	InterfaceInfo *listed = listed_cameras(&error);
	if (error != GC_ERR_SUCCESS)
		return error;
	if (listed != NULL)
		g_ptr_array_add(found, listed);
	/* Who lists cameras wants no broadcast, unless an interface is named as well. */
	if (listed == NULL || g_getenv(INTERFACE_VARIABLE) != NULL)
		add_network_interfaces(found);
	g_mutex_lock(&system->lock);
	if (changed != NULL)
		*changed = !same_interfaces(found, system->interfaces);
	GPtrArray *old = system->interfaces;
	system->interfaces = g_steal_pointer(&found);
	g_mutex_unlock(&system->lock);
	g_ptr_array_unref(old);
	return GC_ERR_SUCCESS;
}

GC_API TLGetNumInterfaces(TL_HANDLE handle, uint32_t *count)
{
	FIND(System, system, handle, SYSTEM);
	REQUIRE(count != NULL, "the pointer to the count is NULL");
	g_mutex_lock(&system->lock);
	*count = system->interfaces->len;
	g_mutex_unlock(&system->lock);
	return GC_ERR_SUCCESS;
}

GC_API TLGetInterfaceID(TL_HANDLE handle, uint32_t index, char *id, size_t *size)
{
	FIND(System, system, handle, SYSTEM);
	g_mutex_lock(&system->lock);
	guint count = system->interfaces->len;
	g_autofree char *found = index < count ? g_strdup(((InterfaceInfo *)system->interfaces->pdata[index])->id) : NULL;
	g_mutex_unlock(&system->lock);
	if (found == NULL)
		return fail(GC_ERR_INVALID_INDEX, "interface %u of %u", index, count);
	return reply_string((Reply){NULL, id, size}, found);
}

/* A copy of an interface's entry, to be freed. */
static InterfaceInfo *find_interface(System *system, const char *id)
{
	InterfaceInfo *copy = NULL;

	g_mutex_lock(&system->lock);
	for (guint i = 0; copy == NULL && i < system->interfaces->len; i++) {
		InterfaceInfo *entry = system->interfaces->pdata[i];
		if (strcmp(entry->id, id) == 0)
			copy = interface_info_copy(entry);
	}
	g_mutex_unlock(&system->lock);
	if (copy == NULL)
		fail(GC_ERR_INVALID_ID, "no interface '%s' since the list was last updated", id);
	return copy;
}

GC_API TLGetInterfaceInfo(TL_HANDLE handle, const char *id, int32_t command, INFO_DATATYPE *type, void *buffer,
			  size_t *size)
{
	FIND(System, system, handle, SYSTEM);
	REQUIRE(id != NULL, "the interface's id is NULL");
	InterfaceInfo *entry = find_interface(system, id);
	if (entry == NULL)
		return GC_ERR_INVALID_ID;
	GC_ERROR error = interface_info_reply(entry, command, (Reply){type, buffer, size});
	interface_info_free(entry);
	return error;
}

GC_API TLOpenInterface(TL_HANDLE handle, const char *id, IF_HANDLE *interface)
{
	FIND(System, system, handle, SYSTEM);
	REQUIRE(id != NULL && interface != NULL, "the interface's id or the pointer to its handle is NULL");
	InterfaceInfo *entry = find_interface(system, id);
	if (entry == NULL)
		return GC_ERR_INVALID_ID;
	GC_ERROR error = interface_open(system, entry, interface);
	interface_info_free(entry);
	return error;
}
