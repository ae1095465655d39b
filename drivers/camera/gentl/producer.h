/* What the producer's files share. Modules (system, interface, device ...) are counted references behind handles that are
 * never used twice, so that a stale or made-up handle is always answered with GC_ERR_INVALID_HANDLE. */
#ifndef POLFUSE_PRODUCER_H
#define POLFUSE_PRODUCER_H

#include <arpa/inet.h>
#include <arv.h>
#include <glib.h>

#include "gentl.h"

#define PRODUCER_VENDOR "PolFuse Lab"
#define PRODUCER_MODEL "Aravis producer"
#define PRODUCER_VERSION "1.0.0"
#define TL_TYPE "GEV"
#define STREAM_ID "stream0"
#define NANOSECONDS_PER_SECOND G_GUINT64_CONSTANT(1000000000)

/* ---- errors.c ---- */

/* Remember code and text for GCGetLastError in this thread; returns the code. */
GC_ERROR fail(GC_ERROR code, const char *format, ...) G_GNUC_PRINTF(2, 3);

/* ---- reply.c: the GenTL way to answer a query ---- */

/* Where an answer goes. buffer == NULL asks for the size only; one that is too small is answered with
 * GC_ERR_BUFFER_TOO_SMALL and the size needed. */
typedef struct {
	INFO_DATATYPE *type;
	void *buffer;
	size_t *size;
} Reply;

GC_ERROR reply_string(Reply reply, const char *text);
GC_ERROR reply_int32(Reply reply, int32_t value);
GC_ERROR reply_uint32(Reply reply, uint32_t value);
GC_ERROR reply_uint64(Reply reply, uint64_t value);
GC_ERROR reply_size(Reply reply, size_t value);
GC_ERROR reply_bool(Reply reply, gboolean value);
GC_ERROR reply_pointer(Reply reply, const void *value);
GC_ERROR reply_unknown(const char *query, int32_t command);

/* ---- modules.c ---- */

typedef enum {
	SYSTEM = 1 << 0,
	INTERFACE = 1 << 1,
	DEVICE = 1 << 2,
	REMOTE_DEVICE = 1 << 3,
	STREAM = 1 << 4,
	BUFFER = 1 << 5,
	EVENT = 1 << 6,
} ModuleKind;

#define PORTS (SYSTEM | INTERFACE | DEVICE | REMOTE_DEVICE | STREAM)

typedef struct Module Module;

typedef struct {
	ModuleKind kind;
	size_t size;
	/* Called once when the module is closed, without locks held: stop what runs, wake who waits. May be NULL. */
	void (*shutdown)(Module *module);
	/* Called when the last reference goes: release memory. May be NULL. */
	void (*finalize)(Module *module);
} ModuleClass;

struct Module {
	const ModuleClass *class;
	Module *parent; /* a reference, or NULL */
	void *handle;	/* NULL until published */
	char *id;	/* unique among siblings of one kind, or NULL */
};

/* A module with one reference, its memory beyond Module zeroed. */
void *module_new(const ModuleClass *class, void *parent, const char *id);
void *module_ref(void *module);
void module_unref(void *module);
/* Give the module a handle and the table's own reference. Fails with GC_ERR_RESOURCE_IN_USE if a sibling of its kind has
 * its id, and with GC_ERR_INVALID_HANDLE if its parent was closed meanwhile. */
GC_ERROR module_publish(void *module);
gboolean module_is_open(ModuleKind kind, const void *parent, const char *id);
/* A reference to the open module of this parent and id, or NULL. */
Module *module_child(ModuleKind kind, const void *parent, const char *id);
/* A reference to the module behind a handle, if it is one of the kinds; else NULL and GC_ERR_INVALID_HANDLE (or
 * GC_ERR_NOT_INITIALIZED) in *error. */
void *module_find(const void *handle, int kinds, GC_ERROR *error);
/* Close a module and all that was opened from it. */
void module_close(void *module);
/* Close the module behind a handle. */
GC_ERROR handle_close(const void *handle, ModuleKind kind);
void modules_close_all(void);

G_DEFINE_AUTOPTR_CLEANUP_FUNC(Module, module_unref)

/* Declares a referenced module that is released when its scope ends, or returns the error. */
#define FIND(Type, name, handle, kinds)                                                     \
	GC_ERROR name##_error = GC_ERR_SUCCESS;                                             \
	g_autoptr(Module) name##_module = module_find((handle), (kinds), &name##_error);    \
	if (name##_module == NULL)                                                          \
		return name##_error;                                                        \
	Type *name = (Type *)name##_module

#define REQUIRE(condition, text)                                                            \
	do {                                                                                \
		if (!(condition))                                                           \
			return fail(GC_ERR_INVALID_PARAMETER, "%s: %s", __func__, (text));  \
	} while (0)

gboolean library_is_ready(void);
char *library_path(void);

/* ---- discovery.c ---- */

typedef struct {
	char address[INET_ADDRSTRLEN];
	char vendor[33], model[33], version[33], serial[17], user_name[17];
	char id[160];
	int32_t access; /* DEVICE_ACCESS_STATUS_... */
} CameraInfo;

/* Ask the targets (struct in_addr each) for cameras from a local address; with broadcast the targets are broadcast
 * addresses and the full time is waited, else until all have answered. Returns an array of CameraInfo, ordered by id;
 * NULL and *error where no socket could be had. */
GPtrArray *discover_cameras(struct in_addr local, const GArray *targets, gboolean broadcast, uint64_t timeout_ms,
			    GC_ERROR *error);
/* The local address from which a camera is reached. */
gboolean local_address_towards(const char *address, char local[INET_ADDRSTRLEN]);

/* ---- system.c, interface.c, device.c ---- */

/* A network interface, or the list of addresses to ask one by one. */
typedef struct {
	char *id, *display_name;
	gboolean broadcast;
	struct in_addr local;
	GArray *targets; /* struct in_addr */
} InterfaceInfo;

typedef struct {
	Module module;
	GMutex lock;
	GPtrArray *interfaces; /* InterfaceInfo */
} System;

typedef struct {
	Module module;
	InterfaceInfo *info;
	GMutex lock;
	GPtrArray *cameras; /* CameraInfo, as found last */
} Interface;

typedef struct {
	Module module;
	CameraInfo info;
	ArvDevice *arv;
	void *remote; /* handle of the camera's own register port; no reference, which would make a circle */
	gint *lost;   /* atomic, a counted reference: the camera stopped answering */
} Device;

InterfaceInfo *interface_info_copy(const InterfaceInfo *info);
void interface_info_free(InterfaceInfo *info);
GC_ERROR interface_info_reply(const InterfaceInfo *info, int32_t command, Reply reply);
GC_ERROR interface_open(System *system, const InterfaceInfo *info, void **handle);
GC_ERROR device_open(Interface *interface, const CameraInfo *info, void **handle);
GC_ERROR camera_info_reply(const CameraInfo *info, int32_t access, int32_t command, Reply reply);
/* Turns an error of Aravis into one of GenTL's and frees it; notes whether the camera has gone. */
GC_ERROR device_failed(Device *device, GError *error, const char *what);
GC_ERROR device_check(Device *device);
gboolean device_is_lost(const Device *device);
/* Release an object of Aravis that talks to the camera when it goes: in the background if the camera is lost, for Aravis
 * waits several seconds for its answers. */
void device_release(const Device *device, gpointer object);

/* ---- local_port.c: registers and description of the producer's own modules ---- */

#define XML_ADDRESS G_GUINT64_CONSTANT(0x100000000)

/* The GenICam description of a port, to be freed. */
char *port_description(Module *port, size_t *size);
GC_ERROR local_port_read(Module *port, uint64_t address, void *buffer, size_t size);
const char *port_name(ModuleKind kind);
/* Copies what of [source_address, + source_size) lies in [address, + size); tells whether anything did. */
gboolean copy_overlap(void *buffer, uint64_t address, size_t size, const void *source, uint64_t source_address,
		      size_t source_size);

/* ---- stream.c, buffer.c, event.c ---- */

typedef enum { HELD, QUEUED, FILLED } BufferState; /* by the client; in the input pool; in the output queue */

/* What the camera told of a frame, copied when it was complete. */
typedef struct {
	gboolean incomplete, image, chunks, too_large;
	ArvBufferPayloadType payload;
	uint64_t timestamp_ns, frame_id, pixel_format;
	size_t filled;
	uint32_t width, height, x_offset, y_offset, x_padding, y_padding;
} FrameInfo;

typedef struct {
	Module module;
	void *memory, *user;
	size_t size;
	gboolean own_memory;
	ArvBuffer *arv;
	/* Below: guarded by the stream's lock. */
	BufferState state;
	gboolean new_data;
	FrameInfo frame;
} Buffer;

typedef struct {
	Module module;
	GMutex acquisition; /* held while starting and stopping; taken before lock; guards closed */
	gboolean closed;    /* never acquires again */
	GMutex lock;
	GCond changed;
	/* Below: guarded by lock. */
	GPtrArray *buffers; /* announced; no references, the table has them */
	GQueue output;	    /* Buffer, FILLED, oldest first */
	ArvStream *arv;	    /* while acquiring */
	uint64_t remaining; /* frames still to be taken, or GENTL_INFINITE */
	uint64_t delivered, started, underruns;
} Stream;

typedef struct {
	Module module; /* its parent is the stream */
	/* Below: guarded by the stream's lock. */
	guint kills;
	gboolean closed;
	uint64_t fired;
} Event;

GC_ERROR stream_open(Device *device, void **handle);
FrameInfo frame_info(ArvBuffer *arv);
/* Put a buffer into the input pool; the stream's lock is held. */
void stream_queue(Stream *stream, Buffer *buffer);
/* The Buffer behind a handle, if it was announced to this stream. */
GC_ERROR buffer_find(Stream *stream, const void *handle, Buffer **buffer);

#endif
