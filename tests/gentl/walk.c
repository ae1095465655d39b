/* Walks the producer's C interface, as a careful and as a careless client, against Aravis' fake camera at 127.0.0.1.
 * Argument: the producer. Prints every expectation that failed; the exit status is their number (at most 99). What is
 * expected is the GenTL standard's: error codes, the size protocol, the life of handles, queues and events. */
#include <dlfcn.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

#include "gentl.h"

/* From arvfakecamera.h: the register that starts and stops the fake camera. */
#define FAKE_ACQUISITION 0x124
/* From the GigE Vision standard: the manufacturer's name, 32 bytes. */
#define VENDOR_REGISTER 0x48
#define BUFFERS 4

static int failures;

#define EXPECT(condition)                                                  \
	do {                                                               \
		if (!(condition)) {                                        \
			printf("walk.c:%d: %s\n", __LINE__, #condition);   \
			failures++;                                        \
		}                                                          \
	} while (0)
#define GIVES(code, call)                                                                       \
	do {                                                                                    \
		GC_ERROR got = (call);                                                          \
		if (got != (code)) {                                                            \
			printf("walk.c:%d: %s gave %d, not %s\n", __LINE__, #call, got, #code); \
			failures++;                                                             \
		}                                                                               \
	} while (0)
#define OK(call) GIVES(GC_ERR_SUCCESS, call)

static void *producer;

/* The functions are looked up by name, as every consumer does. */
#define CALL(name) ((__typeof__(&name))dlsym(producer, #name))

static double seconds(void)
{
	struct timespec now;

	clock_gettime(CLOCK_MONOTONIC, &now);
	return (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
}

static void start_camera(PORT_HANDLE port, int on)
{
	unsigned char value[4] = {0, 0, 0, (unsigned char)on};
	size_t size = sizeof value;

	OK(CALL(GCWritePort)(port, FAKE_ACQUISITION, value, &size));
	/* The fake camera looks at the register, and at where frames are to go, between frames only. */
	usleep(200000);
}

static size_t stream_size(DS_HANDLE stream, int32_t command)
{
	size_t value = 0, size = sizeof value;

	OK(CALL(DSGetInfo)(stream, command, NULL, &value, &size));
	return value;
}

static uint64_t stream_count(DS_HANDLE stream, int32_t command)
{
	uint64_t value = 0;
	size_t size = sizeof value;

	OK(CALL(DSGetInfo)(stream, command, NULL, &value, &size));
	return value;
}

static size_t buffer_size(DS_HANDLE stream, BUFFER_HANDLE buffer, int32_t command)
{
	size_t value = 0, size = sizeof value;

	OK(CALL(DSGetBufferInfo)(stream, buffer, command, NULL, &value, &size));
	return value;
}

static int buffer_flag(DS_HANDLE stream, BUFFER_HANDLE buffer, int32_t command)
{
	bool8_t value = 77;
	size_t size = sizeof value;

	OK(CALL(DSGetBufferInfo)(stream, buffer, command, NULL, &value, &size));
	return value;
}

static GC_ERROR next_frame(EVENT_HANDLE event, EVENT_NEW_BUFFER_DATA *news, uint64_t timeout_ms)
{
	size_t size = sizeof *news;

	return CALL(EventGetData)(event, news, &size, timeout_ms);
}

/* The next whole frame. A busy machine loses packets of a few, and the fake camera does not send them again. */
static GC_ERROR next_whole_frame(DS_HANDLE stream, EVENT_HANDLE event, EVENT_NEW_BUFFER_DATA *news)
{
	for (int attempt = 0; attempt < 30; attempt++) {
		GC_ERROR error = next_frame(event, news, 1500);
		if (error != GC_ERR_SUCCESS || !buffer_flag(stream, news->BufferHandle, BUFFER_INFO_IS_INCOMPLETE))
			return error;
		OK(CALL(DSQueueBuffer)(stream, news->BufferHandle));
	}
	return GC_ERR_NO_DATA;
}

static void before_initialization(void)
{
	TL_HANDLE system = NULL;
	GC_ERROR code = 1;
	char text[512];
	size_t size = sizeof text;

	OK(CALL(GCGetLastError)(&code, text, &size));
	EXPECT(code == GC_ERR_SUCCESS && strcmp(text, "") == 0 && size == 1);
	GIVES(GC_ERR_NOT_INITIALIZED, CALL(TLOpen)(&system));
	GIVES(GC_ERR_NOT_INITIALIZED, CALL(TLClose)(system));
	GIVES(GC_ERR_NOT_INITIALIZED, CALL(GCCloseLib)());
	size = sizeof text;
	OK(CALL(GCGetInfo)(TL_INFO_TLTYPE, NULL, text, &size));
	EXPECT(strcmp(text, "GEV") == 0);
}

static void size_protocol(TL_HANDLE system)
{
	INFO_DATATYPE type = 0;
	GC_ERROR code;
	char text[512] = "";
	size_t needed = 0, size;

	OK(CALL(TLGetInfo)(system, TL_INFO_VENDOR, &type, NULL, &needed));
	EXPECT(type == INFO_DATATYPE_STRING && needed == sizeof "PolFuse Lab");
	size = needed - 1;
	memset(text, 'x', sizeof text);
	GIVES(GC_ERR_BUFFER_TOO_SMALL, CALL(TLGetInfo)(system, TL_INFO_VENDOR, &type, text, &size));
	EXPECT(size == needed && text[0] == 'x');
	OK(CALL(TLGetInfo)(system, TL_INFO_VENDOR, NULL, text, &size));
	EXPECT(strcmp(text, "PolFuse Lab") == 0);
	GIVES(GC_ERR_INVALID_PARAMETER, CALL(TLGetInfo)(system, TL_INFO_VENDOR, &type, text, NULL));
	GIVES(GC_ERR_NOT_IMPLEMENTED, CALL(TLGetInfo)(system, 999, &type, text, &size));
	size = sizeof text;
	OK(CALL(GCGetLastError)(&code, text, &size));
	EXPECT(code == GC_ERR_NOT_IMPLEMENTED && strstr(text, "999") != NULL && size == strlen(text) + 1);
	size = 3;
	GIVES(GC_ERR_BUFFER_TOO_SMALL, CALL(GCGetLastError)(&code, text, &size));
	EXPECT(size > 3);
	GIVES(GC_ERR_INVALID_PARAMETER, CALL(GCGetLastError)(NULL, text, &size));
	uint32_t major = 0;
	size = sizeof major;
	OK(CALL(TLGetInfo)(system, TL_INFO_GENTL_VER_MAJOR, &type, &major, &size));
	EXPECT(type == INFO_DATATYPE_UINT32 && size == 4 && major == 1);
}

/* Every function that takes a handle, with one that is none of its kind. */
static void wrong_handle(void *wrong)
{
	char text[64];
	size_t size = sizeof text;
	uint32_t count;
	void *out, *user;
	bool8_t changed;
	PORT_REGISTER_STACK_ENTRY entry = {0, text, 4};
	SINGLE_CHUNK_DATA chunk;

	GIVES(GC_ERR_INVALID_HANDLE, CALL(TLClose)(wrong));
	GIVES(GC_ERR_INVALID_HANDLE, CALL(TLGetInfo)(wrong, 0, NULL, text, &size));
	GIVES(GC_ERR_INVALID_HANDLE, CALL(TLGetNumInterfaces)(wrong, &count));
	GIVES(GC_ERR_INVALID_HANDLE, CALL(TLGetInterfaceID)(wrong, 0, text, &size));
	GIVES(GC_ERR_INVALID_HANDLE, CALL(TLGetInterfaceInfo)(wrong, "x", 0, NULL, text, &size));
	GIVES(GC_ERR_INVALID_HANDLE, CALL(TLOpenInterface)(wrong, "x", &out));
	GIVES(GC_ERR_INVALID_HANDLE, CALL(TLUpdateInterfaceList)(wrong, &changed, 0));
	GIVES(GC_ERR_INVALID_HANDLE, CALL(IFClose)(wrong));
	GIVES(GC_ERR_INVALID_HANDLE, CALL(IFGetInfo)(wrong, 0, NULL, text, &size));
	GIVES(GC_ERR_INVALID_HANDLE, CALL(IFGetParentTL)(wrong, &out));
	GIVES(GC_ERR_INVALID_HANDLE, CALL(IFGetNumDevices)(wrong, &count));
	GIVES(GC_ERR_INVALID_HANDLE, CALL(IFGetDeviceID)(wrong, 0, text, &size));
	GIVES(GC_ERR_INVALID_HANDLE, CALL(IFGetDeviceInfo)(wrong, "x", 0, NULL, text, &size));
	GIVES(GC_ERR_INVALID_HANDLE, CALL(IFUpdateDeviceList)(wrong, &changed, 0));
	GIVES(GC_ERR_INVALID_HANDLE, CALL(IFOpenDevice)(wrong, "x", DEVICE_ACCESS_CONTROL, &out));
	GIVES(GC_ERR_INVALID_HANDLE, CALL(DevClose)(wrong));
	GIVES(GC_ERR_INVALID_HANDLE, CALL(DevGetPort)(wrong, &out));
	GIVES(GC_ERR_INVALID_HANDLE, CALL(DevGetInfo)(wrong, 0, NULL, text, &size));
	GIVES(GC_ERR_INVALID_HANDLE, CALL(DevGetParentIF)(wrong, &out));
	GIVES(GC_ERR_INVALID_HANDLE, CALL(DevGetNumDataStreams)(wrong, &count));
	GIVES(GC_ERR_INVALID_HANDLE, CALL(DevGetDataStreamID)(wrong, 0, text, &size));
	GIVES(GC_ERR_INVALID_HANDLE, CALL(DevOpenDataStream)(wrong, "x", &out));
	GIVES(GC_ERR_INVALID_HANDLE, CALL(DSClose)(wrong));
	GIVES(GC_ERR_INVALID_HANDLE, CALL(DSGetParentDev)(wrong, &out));
	GIVES(GC_ERR_INVALID_HANDLE, CALL(DSGetInfo)(wrong, 0, NULL, text, &size));
	GIVES(GC_ERR_INVALID_HANDLE, CALL(DSAnnounceBuffer)(wrong, text, 64, NULL, &out));
	GIVES(GC_ERR_INVALID_HANDLE, CALL(DSAllocAndAnnounceBuffer)(wrong, 64, NULL, &out));
	GIVES(GC_ERR_INVALID_HANDLE, CALL(DSRevokeBuffer)(wrong, NULL, &out, &user));
	GIVES(GC_ERR_INVALID_HANDLE, CALL(DSQueueBuffer)(wrong, NULL));
	GIVES(GC_ERR_INVALID_HANDLE, CALL(DSFlushQueue)(wrong, ACQ_QUEUE_ALL_DISCARD));
	GIVES(GC_ERR_INVALID_HANDLE, CALL(DSStartAcquisition)(wrong, 0, 1));
	GIVES(GC_ERR_INVALID_HANDLE, CALL(DSStopAcquisition)(wrong, 0));
	GIVES(GC_ERR_INVALID_HANDLE, CALL(DSGetBufferID)(wrong, 0, &out));
	GIVES(GC_ERR_INVALID_HANDLE, CALL(DSGetBufferInfo)(wrong, NULL, 0, NULL, text, &size));
	GIVES(GC_ERR_INVALID_HANDLE, CALL(DSGetBufferChunkData)(wrong, NULL, &chunk, &size));
	GIVES(GC_ERR_INVALID_HANDLE, CALL(DSGetNumBufferParts)(wrong, NULL, &count));
	GIVES(GC_ERR_INVALID_HANDLE, CALL(GCReadPort)(wrong, 0, text, &size));
	GIVES(GC_ERR_INVALID_HANDLE, CALL(GCWritePort)(wrong, 0, text, &size));
	GIVES(GC_ERR_INVALID_HANDLE, CALL(GCReadPortStacked)(wrong, &entry, &size));
	GIVES(GC_ERR_INVALID_HANDLE, CALL(GCWritePortStacked)(wrong, &entry, &size));
	GIVES(GC_ERR_INVALID_HANDLE, CALL(GCGetPortInfo)(wrong, 0, NULL, text, &size));
	GIVES(GC_ERR_INVALID_HANDLE, CALL(GCGetPortURL)(wrong, text, &size));
	GIVES(GC_ERR_INVALID_HANDLE, CALL(GCGetNumPortURLs)(wrong, &count));
	GIVES(GC_ERR_INVALID_HANDLE, CALL(GCGetPortURLInfo)(wrong, 0, 0, NULL, text, &size));
	GIVES(GC_ERR_INVALID_HANDLE, CALL(GCRegisterEvent)(wrong, EVENT_NEW_BUFFER, &out));
	GIVES(GC_ERR_INVALID_HANDLE, CALL(GCUnregisterEvent)(wrong, EVENT_NEW_BUFFER));
	GIVES(GC_ERR_INVALID_HANDLE, CALL(EventGetData)(wrong, text, &size, 0));
	GIVES(GC_ERR_INVALID_HANDLE, CALL(EventGetDataInfo)(wrong, text, size, 0, NULL, text, &size));
	GIVES(GC_ERR_INVALID_HANDLE, CALL(EventGetInfo)(wrong, 0, NULL, text, &size));
	GIVES(GC_ERR_INVALID_HANDLE, CALL(EventFlush)(wrong));
	GIVES(GC_ERR_INVALID_HANDLE, CALL(EventKill)(wrong));
}

static DEV_HANDLE open_device(TL_HANDLE system)
{
	IF_HANDLE interface = NULL, parent = NULL;
	DEV_HANDLE device = NULL, again = NULL;
	bool8_t changed = 7;
	uint32_t count = 77;
	char id[256];
	size_t size = sizeof id;
	int32_t access = 0;

	OK(CALL(TLGetNumInterfaces)(system, &count));
	EXPECT(count == 0); /* nothing before the first update */
	OK(CALL(TLUpdateInterfaceList)(system, &changed, 100));
	EXPECT(changed == 1);
	OK(CALL(TLUpdateInterfaceList)(system, &changed, 100));
	EXPECT(changed == 0);
	OK(CALL(TLGetNumInterfaces)(system, &count));
	EXPECT(count == 1);
	GIVES(GC_ERR_INVALID_INDEX, CALL(TLGetInterfaceID)(system, 1, id, &size));
	size = sizeof id;
	OK(CALL(TLGetInterfaceID)(system, 0, id, &size));
	EXPECT(strcmp(id, "addresses") == 0);
	GIVES(GC_ERR_INVALID_ID, CALL(TLOpenInterface)(system, "eth77", &interface));
	GIVES(GC_ERR_INVALID_PARAMETER, CALL(TLOpenInterface)(system, NULL, &interface));
	OK(CALL(TLOpenInterface)(system, id, &interface));
	GIVES(GC_ERR_RESOURCE_IN_USE, CALL(TLOpenInterface)(system, id, &again));
	OK(CALL(IFGetParentTL)(interface, &parent));
	EXPECT(parent == system);
	OK(CALL(IFUpdateDeviceList)(interface, &changed, 2000));
	EXPECT(changed == 1);
	OK(CALL(IFGetNumDevices)(interface, &count));
	EXPECT(count == 1);
	size = sizeof id;
	OK(CALL(IFGetDeviceID)(interface, 0, id, &size));
	EXPECT(strcmp(id, "Aravis-Fake-GV01@127.0.0.1") == 0);
	size = sizeof access;
	OK(CALL(IFGetDeviceInfo)(interface, id, DEVICE_INFO_ACCESS_STATUS, NULL, &access, &size));
	EXPECT(access == DEVICE_ACCESS_STATUS_READWRITE);
	GIVES(GC_ERR_INVALID_ID, CALL(IFOpenDevice)(interface, "x", DEVICE_ACCESS_CONTROL, &device));
	GIVES(GC_ERR_NOT_IMPLEMENTED, CALL(IFOpenDevice)(interface, id, DEVICE_ACCESS_READONLY, &device));
	GIVES(GC_ERR_INVALID_PARAMETER, CALL(IFOpenDevice)(interface, id, 77, &device));
	OK(CALL(IFOpenDevice)(interface, id, DEVICE_ACCESS_EXCLUSIVE, &device));
	GIVES(GC_ERR_RESOURCE_IN_USE, CALL(IFOpenDevice)(interface, id, DEVICE_ACCESS_EXCLUSIVE, &again));
	size = sizeof access;
	OK(CALL(IFGetDeviceInfo)(interface, id, DEVICE_INFO_ACCESS_STATUS, NULL, &access, &size));
	EXPECT(access == DEVICE_ACCESS_STATUS_OPEN_READWRITE);
	wrong_handle(again);
	return device;
}

static void ports(DEV_HANDLE device, PORT_HANDLE port)
{
	char vendor[32] = "", part[5] = "", url[256], file[128];
	unsigned char word[4];
	size_t size = sizeof vendor, count;
	unsigned long long address = 0, length = 0;

	OK(CALL(GCReadPort)(port, VENDOR_REGISTER, vendor, &size));
	EXPECT(strcmp(vendor, "Aravis") == 0);
	size = 4;
	OK(CALL(GCReadPort)(port, VENDOR_REGISTER + 1, part, &size)); /* neither begins nor ends with a word */
	EXPECT(strcmp(part, "ravi") == 0);
	size = 4;
	OK(CALL(GCReadPort)(port, VENDOR_REGISTER, word, &size)); /* bytes in the camera's order */
	EXPECT(memcmp(word, "Arav", 4) == 0);
	GIVES(GC_ERR_INVALID_ADDRESS, CALL(GCReadPort)(port, UINT64_MAX - 1, word, &size));
	GIVES(GC_ERR_INVALID_ADDRESS, CALL(GCReadPort)(port, 0xfffffffe, word, &size));
	GIVES(GC_ERR_INVALID_ADDRESS, CALL(GCWritePort)(port, FAKE_ACQUISITION + 1, word, &size));
	GIVES(GC_ERR_INVALID_PARAMETER, CALL(GCReadPort)(port, 0, NULL, &size));
	GIVES(GC_ERR_ACCESS_DENIED, CALL(GCWritePort)(device, 0x1000, word, &size));
	GIVES(GC_ERR_INVALID_ADDRESS, CALL(GCReadPort)(device, 0x77770000, word, &size));
	PORT_REGISTER_STACK_ENTRY entries[3] = {
		{VENDOR_REGISTER, vendor, 4}, {UINT64_MAX - 8, word, 4}, {VENDOR_REGISTER, word, 4}};
	count = 3;
	GIVES(GC_ERR_INVALID_ADDRESS, CALL(GCReadPortStacked)(port, entries, &count));
	EXPECT(count == 1);
	count = 1;
	OK(CALL(GCReadPortStacked)(port, entries, &count));
	EXPECT(count == 1);

	PORT_HANDLE both[2] = {port, device};
	for (int i = 0; i < 2; i++) {
		size = sizeof url;
		OK(CALL(GCGetPortURL)(both[i], url, &size));
		EXPECT(sscanf(url, "Local:%127[^;];%llx;%llx", file, &address, &length) == 3);
		char *xml = calloc(length + 1, 1);
		size = (size_t)length;
		OK(CALL(GCReadPort)(both[i], address, xml, &size));
		EXPECT(strstr(xml, "<RegisterDescription") != NULL && strstr(xml, "</RegisterDescription>") != NULL);
		free(xml);
	}
	GIVES(GC_ERR_INVALID_INDEX, CALL(GCGetPortURLInfo)(port, 1, URL_INFO_URL, NULL, url, &size));
}

static void queues(DS_HANDLE stream, BUFFER_HANDLE buffers[BUFFERS], void *memory[BUFFERS], size_t payload)
{
	EVENT_HANDLE event = NULL, again;
	EVENT_NEW_BUFFER_DATA news;
	BUFFER_HANDLE found;
	void *where, *user;

	GIVES(GC_ERR_INVALID_PARAMETER, CALL(DSAnnounceBuffer)(stream, NULL, payload, NULL, &buffers[0]));
	GIVES(GC_ERR_INVALID_PARAMETER, CALL(DSAnnounceBuffer)(stream, memory[0], 0, NULL, &buffers[0]));
	for (int i = 0; i < BUFFERS; i++)
		OK(CALL(DSAnnounceBuffer)(stream, memory[i], payload, &memory[i], &buffers[i]));
	OK(CALL(DSGetBufferID)(stream, 1, &found));
	EXPECT(found == buffers[1]);
	GIVES(GC_ERR_INVALID_INDEX, CALL(DSGetBufferID)(stream, BUFFERS, &found));
	OK(CALL(DSQueueBuffer)(stream, buffers[0]));
	GIVES(GC_ERR_RESOURCE_IN_USE, CALL(DSQueueBuffer)(stream, buffers[0]));
	GIVES(GC_ERR_BUSY, CALL(DSRevokeBuffer)(stream, buffers[0], &where, &user));
	GIVES(GC_ERR_INVALID_BUFFER, CALL(DSQueueBuffer)(stream, stream));
	GIVES(GC_ERR_INVALID_BUFFER, CALL(DSQueueBuffer)(stream, NULL));
	EXPECT(stream_size(stream, STREAM_INFO_NUM_ANNOUNCED) == BUFFERS);
	EXPECT(stream_size(stream, STREAM_INFO_NUM_QUEUED) == 1);
	/* Input to output: delivered, but without new data. */
	OK(CALL(GCRegisterEvent)(stream, EVENT_NEW_BUFFER, &event));
	GIVES(GC_ERR_RESOURCE_IN_USE, CALL(GCRegisterEvent)(stream, EVENT_NEW_BUFFER, &again));
	GIVES(GC_ERR_NOT_IMPLEMENTED, CALL(GCRegisterEvent)(stream, EVENT_ERROR, &again));
	OK(CALL(DSFlushQueue)(stream, ACQ_QUEUE_INPUT_TO_OUTPUT));
	EXPECT(stream_size(stream, STREAM_INFO_NUM_AWAIT_DELIVERY) == 1);
	OK(next_frame(event, &news, 0));
	EXPECT(news.BufferHandle == buffers[0] && news.pUserPointer == &memory[0]);
	EXPECT(!buffer_flag(stream, buffers[0], BUFFER_INFO_NEW_DATA));
	EXPECT(!buffer_flag(stream, buffers[0], BUFFER_INFO_IS_QUEUED));
	size_t count = 1;
	SINGLE_CHUNK_DATA chunk;
	GIVES(GC_ERR_NO_DATA, CALL(DSGetBufferChunkData)(stream, buffers[0], &chunk, &count));
	/* Revoked: the memory and the pointer come back, the handle is void. */
	OK(CALL(DSRevokeBuffer)(stream, buffers[0], &where, &user));
	EXPECT(where == memory[0] && user == &memory[0]);
	GIVES(GC_ERR_INVALID_BUFFER, CALL(DSRevokeBuffer)(stream, buffers[0], &where, &user));
	OK(CALL(DSAllocAndAnnounceBuffer)(stream, payload, NULL, &buffers[0]));
	OK(CALL(DSFlushQueue)(stream, ACQ_QUEUE_UNQUEUED_TO_INPUT));
	EXPECT(stream_size(stream, STREAM_INFO_NUM_QUEUED) == BUFFERS);
	GIVES(GC_ERR_INVALID_PARAMETER, CALL(DSFlushQueue)(stream, 77));
	OK(CALL(GCUnregisterEvent)(stream, EVENT_NEW_BUFFER));
	GIVES(GC_ERR_INVALID_ID, CALL(GCUnregisterEvent)(stream, EVENT_NEW_BUFFER));
	GIVES(GC_ERR_INVALID_HANDLE, next_frame(event, &news, 0));
}

typedef struct {
	EVENT_HANDLE event;
	GC_ERROR result;
	double waited_s;
} Waiter;

static void *wait_long(void *data)
{
	Waiter *waiter = data;
	EVENT_NEW_BUFFER_DATA news;
	double start = seconds();

	waiter->result = next_frame(waiter->event, &news, GENTL_INFINITE);
	waiter->waited_s = seconds() - start;
	return NULL;
}

static void waits(DS_HANDLE stream)
{
	Waiter waiter = {.event = NULL};
	EVENT_NEW_BUFFER_DATA news;
	pthread_t thread;
	size_t size = 3;

	OK(CALL(GCRegisterEvent)(stream, EVENT_NEW_BUFFER, &waiter.event));
	double start = seconds();
	GIVES(GC_ERR_TIMEOUT, next_frame(waiter.event, &news, 100));
	EXPECT(seconds() - start >= 0.1 && seconds() - start < 2);
	GIVES(GC_ERR_BUFFER_TOO_SMALL, CALL(EventGetData)(waiter.event, &news, &size, 0));
	OK(CALL(EventKill)(waiter.event)); /* nobody waits: the next wait ends at once, the one after does not */
	GIVES(GC_ERR_ABORT, next_frame(waiter.event, &news, GENTL_INFINITE));
	GIVES(GC_ERR_TIMEOUT, next_frame(waiter.event, &news, 0));
	pthread_create(&thread, NULL, wait_long, &waiter);
	usleep(100000);
	OK(CALL(EventKill)(waiter.event));
	pthread_join(thread, NULL);
	EXPECT(waiter.result == GC_ERR_ABORT && waiter.waited_s < 5);
	pthread_create(&thread, NULL, wait_long, &waiter);
	usleep(100000);
	OK(CALL(GCUnregisterEvent)(stream, EVENT_NEW_BUFFER));
	pthread_join(thread, NULL);
	EXPECT(waiter.result == GC_ERR_ABORT);
}

static void acquires(DS_HANDLE stream, PORT_HANDLE port, size_t payload)
{
	EVENT_HANDLE event = NULL;
	EVENT_NEW_BUFFER_DATA news = {NULL, NULL}, held[BUFFERS];
	uint64_t last = 0, id = 0;
	size_t size;

	OK(CALL(GCRegisterEvent)(stream, EVENT_NEW_BUFFER, &event));
	GIVES(GC_ERR_INVALID_PARAMETER, CALL(DSStartAcquisition)(stream, 0, 0));
	OK(CALL(DSStartAcquisition)(stream, ACQ_START_FLAGS_DEFAULT, GENTL_INFINITE));
	GIVES(GC_ERR_RESOURCE_IN_USE, CALL(DSStartAcquisition)(stream, 0, GENTL_INFINITE));
	start_camera(port, 1);
	for (int i = 0; i < 10; i++) {
		OK(next_whole_frame(stream, event, &news));
		EXPECT(buffer_flag(stream, news.BufferHandle, BUFFER_INFO_NEW_DATA));
		EXPECT(buffer_size(stream, news.BufferHandle, BUFFER_INFO_SIZE_FILLED) == payload);
		EXPECT(buffer_size(stream, news.BufferHandle, BUFFER_INFO_WIDTH) *
			       buffer_size(stream, news.BufferHandle, BUFFER_INFO_HEIGHT) == payload);
		EXPECT(buffer_size(stream, news.BufferHandle, BUFFER_INFO_PAYLOADTYPE) == PAYLOAD_TYPE_IMAGE);
		size = sizeof id;
		OK(CALL(DSGetBufferInfo)(stream, news.BufferHandle, BUFFER_INFO_FRAMEID, NULL, &id, &size));
		EXPECT(i == 0 || id > last);
		last = id;
		OK(CALL(DSQueueBuffer)(stream, news.BufferHandle));
	}
	/* A client that keeps all buffers starves the stream, which tells so, and lives on once it gives them back. */
	for (int i = 0; i < BUFFERS; i++)
		OK(next_frame(event, &held[i], 1500));
	GIVES(GC_ERR_TIMEOUT, next_frame(event, &news, 300));
	EXPECT(stream_count(stream, STREAM_INFO_NUM_UNDERRUN) > 0);
	for (int i = 0; i < BUFFERS; i++)
		OK(CALL(DSQueueBuffer)(stream, held[i].BufferHandle));
	OK(next_frame(event, &news, 1500));
	/* Flushed while acquiring: all buffers are the client's, and can be queued again. */
	OK(CALL(DSFlushQueue)(stream, ACQ_QUEUE_ALL_DISCARD));
	EXPECT(stream_size(stream, STREAM_INFO_NUM_QUEUED) == 0);
	GIVES(GC_ERR_TIMEOUT, next_frame(event, &news, 150));
	OK(CALL(DSFlushQueue)(stream, ACQ_QUEUE_ALL_TO_INPUT));
	for (int i = 0; i < 3; i++) {
		OK(next_frame(event, &news, 1500));
		OK(CALL(DSQueueBuffer)(stream, news.BufferHandle));
	}
	start_camera(port, 0);
	OK(CALL(DSStopAcquisition)(stream, ACQ_STOP_FLAGS_DEFAULT));
	OK(CALL(DSStopAcquisition)(stream, ACQ_STOP_FLAGS_KILL)); /* idempotent */
	OK(CALL(EventFlush)(event));
	GIVES(GC_ERR_TIMEOUT, next_frame(event, &news, 150));
	/* Two frames asked for, two delivered, though the camera sends on. */
	OK(CALL(DSFlushQueue)(stream, ACQ_QUEUE_UNQUEUED_TO_INPUT));
	OK(CALL(DSStartAcquisition)(stream, 0, 2));
	start_camera(port, 1);
	OK(next_frame(event, &news, 1500));
	OK(next_frame(event, &news, 1500));
	GIVES(GC_ERR_TIMEOUT, next_frame(event, &news, 300));
	start_camera(port, 0);
	OK(CALL(GCUnregisterEvent)(stream, EVENT_NEW_BUFFER));
}

/* Everything is closed at once while a stream acquires and a thread waits. */
static void closes_under_way(TL_HANDLE system, DS_HANDLE stream, PORT_HANDLE port)
{
	Waiter waiter = {.event = NULL};
	pthread_t thread;

	OK(CALL(DSStopAcquisition)(stream, 0));
	OK(CALL(DSFlushQueue)(stream, ACQ_QUEUE_ALL_DISCARD)); /* no buffers: the thread waits for ever */
	OK(CALL(GCRegisterEvent)(stream, EVENT_NEW_BUFFER, &waiter.event));
	OK(CALL(DSStartAcquisition)(stream, 0, GENTL_INFINITE));
	start_camera(port, 1);
	pthread_create(&thread, NULL, wait_long, &waiter);
	usleep(100000);
	OK(CALL(TLClose)(system));
	pthread_join(thread, NULL);
	EXPECT(waiter.result == GC_ERR_ABORT);
}

int main(int argc, char **argv)
{
	TL_HANDLE system = NULL, again = NULL;
	DS_HANDLE stream = NULL;
	PORT_HANDLE port = NULL;
	BUFFER_HANDLE buffers[BUFFERS];
	void *memory[BUFFERS];

	producer = argc == 2 ? dlopen(argv[1], RTLD_NOW | RTLD_LOCAL) : NULL;
	if (producer == NULL) {
		printf("%s\n", argc == 2 ? dlerror() : "usage: walk PRODUCER");
		return 99;
	}
	before_initialization();
	OK(CALL(GCInitLib)());
	GIVES(GC_ERR_RESOURCE_IN_USE, CALL(GCInitLib)());
	wrong_handle(NULL);
	wrong_handle((void *)(uintptr_t)0x1234);
	wrong_handle(&failures);
	GIVES(GC_ERR_INVALID_PARAMETER, CALL(TLOpen)(NULL));
	OK(CALL(TLOpen)(&system));
	GIVES(GC_ERR_RESOURCE_IN_USE, CALL(TLOpen)(&again));
	size_protocol(system);

	DEV_HANDLE device = open_device(system);
	OK(CALL(DevGetPort)(device, &port));
	GIVES(GC_ERR_INVALID_HANDLE, CALL(TLClose)(device)); /* a handle of another kind */
	start_camera(port, 0);				      /* whoever had it before may have left it running */
	ports(device, port);
	GIVES(GC_ERR_INVALID_ID, CALL(DevOpenDataStream)(device, "x", &stream));
	OK(CALL(DevOpenDataStream)(device, "stream0", &stream));
	GIVES(GC_ERR_RESOURCE_IN_USE, CALL(DevOpenDataStream)(device, "stream0", &again));
	size_t payload = stream_size(stream, STREAM_INFO_PAYLOAD_SIZE);
	EXPECT(payload == 512 * 512);
	for (int i = 0; i < BUFFERS; i++)
		memory[i] = malloc(payload);
	queues(stream, buffers, memory, payload);
	waits(stream);
	acquires(stream, port, payload);
	closes_under_way(system, stream, port);
	for (int i = 0; i < BUFFERS; i++)
		free(memory[i]); /* must not be written to any more */
	wrong_handle(system);
	wrong_handle(device);
	wrong_handle(stream);
	wrong_handle(port);
	OK(CALL(GCCloseLib)());

	/* Once more from the start: the camera was let go of. */
	OK(CALL(GCInitLib)());
	OK(CALL(TLOpen)(&system));
	device = open_device(system);
	OK(CALL(DevOpenDataStream)(device, "stream0", &stream));
	OK(CALL(GCCloseLib)());
	dlclose(producer);
	return failures < 99 ? failures : 99;
}
