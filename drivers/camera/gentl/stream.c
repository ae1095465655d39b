/* Acquisition. Frames go straight into the client's memory: every announced buffer is an ArvBuffer over it, given to Aravis
 * while it is in the input pool. Aravis calls back when one is complete; it then waits in the output queue. */
#include "producer.h"

#define SOCKET_BUFFER_SIZE (8 * 1024 * 1024) /* the kernel grants at most net.core.rmem_max */

static void stop(Stream *stream)
{
	g_mutex_lock(&stream->acquisition);
	g_mutex_lock(&stream->lock);
	ArvStream *arv = g_steal_pointer(&stream->arv);
	g_mutex_unlock(&stream->lock);
	if (arv != NULL) {
		guint64 completed, failed, underruns;
		arv_stream_get_statistics(arv, &completed, &failed, &underruns);
		/* Joins Aravis' thread, whose callback takes the lock: so without it. Afterwards no buffer is written to any
		 * more; those that Aravis held stay in the input pool. */
		arv_stream_stop_thread(arv, TRUE);
		arv_stream_start_thread(arv); /* without buffers; Aravis expects a thread when the stream goes */
		device_release((Device *)stream->module.parent, arv);
		g_mutex_lock(&stream->lock);
		stream->underruns += underruns;
		g_mutex_unlock(&stream->lock);
	}
	g_mutex_unlock(&stream->acquisition);
}

static void close_stream(Module *module)
{
	Stream *stream = (Stream *)module;

	g_mutex_lock(&stream->acquisition);
	stream->closed = TRUE;
	g_mutex_unlock(&stream->acquisition);
	stop(stream);
	g_mutex_lock(&stream->lock);
	g_queue_clear(&stream->output);
	g_ptr_array_set_size(stream->buffers, 0);
	g_mutex_unlock(&stream->lock);
}

static void finalize(Module *module)
{
	Stream *stream = (Stream *)module;

	g_ptr_array_unref(stream->buffers);
	g_mutex_clear(&stream->acquisition);
	g_mutex_clear(&stream->lock);
	g_cond_clear(&stream->changed);
}

static const ModuleClass stream_class = {
	.kind = STREAM, .size = sizeof(Stream), .shutdown = close_stream, .finalize = finalize};

GC_ERROR stream_open(Device *device, void **handle)
{
	g_autoptr(Module) module = module_new(&stream_class, device, STREAM_ID);
	Stream *stream = (Stream *)module;

	g_mutex_init(&stream->acquisition);
	g_mutex_init(&stream->lock);
	g_cond_init(&stream->changed);
	g_queue_init(&stream->output);
	/* Without references: the table holds buffers, and a buffer holds its stream. */
	stream->buffers = g_ptr_array_new();
	GC_ERROR error = module_publish(stream);
	if (error == GC_ERR_SUCCESS)
		*handle = module->handle;
	return error;
}

void stream_queue(Stream *stream, Buffer *buffer)
{
	buffer->state = QUEUED;
	buffer->new_data = FALSE;
	if (stream->arv != NULL)
		arv_stream_push_buffer(stream->arv, g_object_ref(buffer->arv));
}

/* Called in Aravis' thread. */
static void on_buffer(void *data, ArvStreamCallbackType type, ArvBuffer *arv)
{
	Stream *stream = data;

	(void)arv;
	if (type != ARV_STREAM_CALLBACK_TYPE_BUFFER_DONE)
		return;
	g_mutex_lock(&stream->lock);
	ArvBuffer *done = stream->arv != NULL ? arv_stream_try_pop_buffer(stream->arv) : NULL;
	if (done != NULL) {
		Buffer *buffer = (Buffer *)(uintptr_t)arv_buffer_get_user_data(done);
		ArvBufferStatus status = arv_buffer_get_status(done);
		if (status == ARV_BUFFER_STATUS_CLEARED || status == ARV_BUFFER_STATUS_ABORTED || stream->remaining == 0) {
			stream_queue(stream, buffer); /* no frame, or one that was not asked for */
		} else {
			buffer->frame = frame_info(done);
			buffer->state = FILLED;
			buffer->new_data = TRUE;
			stream->started++;
			if (stream->remaining != GENTL_INFINITE)
				stream->remaining--;
			g_queue_push_tail(&stream->output, buffer);
			g_cond_broadcast(&stream->changed);
		}
		g_object_unref(done);
	}
	g_mutex_unlock(&stream->lock);
}

static GC_ERROR start(Stream *stream, uint64_t frames)
{
	Device *device = (Device *)stream->module.parent;
	GError *problem = NULL;
	GC_ERROR error = device_check(device);

	if (error != GC_ERR_SUCCESS)
		return error;
	if (stream->closed)
		return fail(GC_ERR_INVALID_HANDLE, "the stream was closed meanwhile");
	ArvStream *arv = arv_device_create_stream(device->arv, on_buffer, stream, &problem);
	if (arv == NULL)
		return device_failed(device, problem, "opening the stream");
	g_object_set(arv, "socket-buffer", ARV_GV_STREAM_SOCKET_BUFFER_FIXED, "socket-buffer-size",
		     (gint)SOCKET_BUFFER_SIZE, NULL);
	g_mutex_lock(&stream->lock);
	stream->arv = arv;
	stream->remaining = frames;
	for (guint i = 0; i < stream->buffers->len; i++) {
		Buffer *buffer = stream->buffers->pdata[i];
		if (buffer->state == QUEUED)
			stream_queue(stream, buffer);
	}
	g_mutex_unlock(&stream->lock);
	return GC_ERR_SUCCESS;
}

GC_API DSStartAcquisition(DS_HANDLE handle, int32_t flags, uint64_t frames)
{
	FIND(Stream, stream, handle, STREAM);
	REQUIRE(flags == ACQ_START_FLAGS_DEFAULT, "unknown flags");
	REQUIRE(frames != 0, "no frames to acquire; ask for GENTL_INFINITE or at least one");
	g_mutex_lock(&stream->acquisition);
	GC_ERROR error = stream->arv != NULL ? fail(GC_ERR_RESOURCE_IN_USE, "the stream is acquiring already") :
					       start(stream, frames);
	g_mutex_unlock(&stream->acquisition);
	return error;
}

GC_API DSStopAcquisition(DS_HANDLE handle, int32_t flags)
{
	FIND(Stream, stream, handle, STREAM);
	REQUIRE(flags == ACQ_STOP_FLAGS_DEFAULT || flags == ACQ_STOP_FLAGS_KILL, "unknown flags");
	stop(stream);
	return GC_ERR_SUCCESS;
}

GC_API DSClose(DS_HANDLE handle)
{
	return handle_close(handle, STREAM);
}

GC_API DSGetParentDev(DS_HANDLE handle, DEV_HANDLE *device)
{
	FIND(Stream, stream, handle, STREAM);
	REQUIRE(device != NULL, "the pointer to the handle is NULL");
	*device = stream->module.parent->handle;
	return GC_ERR_SUCCESS;
}

/* What an operation makes of a buffer; the lock is held. */
static void flush_buffer(Stream *stream, Buffer *buffer, int32_t operation)
{
	switch (operation) {
	case ACQ_QUEUE_INPUT_TO_OUTPUT:
		if (buffer->state == QUEUED) {
			buffer->state = FILLED;
			g_queue_push_tail(&stream->output, buffer);
		}
		break;
	case ACQ_QUEUE_OUTPUT_DISCARD:
		if (buffer->state == FILLED)
			buffer->state = HELD;
		break;
	case ACQ_QUEUE_ALL_TO_INPUT:
		if (buffer->state != QUEUED)
			stream_queue(stream, buffer);
		break;
	case ACQ_QUEUE_UNQUEUED_TO_INPUT:
		if (buffer->state == HELD)
			stream_queue(stream, buffer);
		break;
	default:
		buffer->state = HELD;
		break;
	}
}

GC_API DSFlushQueue(DS_HANDLE handle, int32_t operation)
{
	FIND(Stream, stream, handle, STREAM);
	REQUIRE(operation >= ACQ_QUEUE_INPUT_TO_OUTPUT && operation <= ACQ_QUEUE_ALL_DISCARD, "unknown operation");
	gboolean empties_input = operation == ACQ_QUEUE_INPUT_TO_OUTPUT || operation == ACQ_QUEUE_ALL_DISCARD;
	gboolean empties_output = operation == ACQ_QUEUE_OUTPUT_DISCARD || operation == ACQ_QUEUE_ALL_TO_INPUT ||
				  operation == ACQ_QUEUE_ALL_DISCARD;

	g_mutex_lock(&stream->acquisition);
	ArvStream *paused = empties_input ? stream->arv : NULL;
	if (paused != NULL)
		/* Aravis gives buffers back only when its thread rests. Without the lock: its callback takes it. */
		arv_stream_stop_thread(paused, TRUE);
	g_mutex_lock(&stream->lock);
	if (empties_output)
		g_queue_clear(&stream->output);
	for (guint i = 0; i < stream->buffers->len; i++)
		flush_buffer(stream, stream->buffers->pdata[i], operation);
	g_cond_broadcast(&stream->changed);
	g_mutex_unlock(&stream->lock);
	if (paused != NULL)
		arv_stream_start_thread(paused);
	g_mutex_unlock(&stream->acquisition);
	return GC_ERR_SUCCESS;
}

static GC_ERROR reply_payload_size(Stream *stream, Reply reply)
{
	Device *device = (Device *)stream->module.parent;
	GError *problem = NULL;
	GC_ERROR error = device_check(device);

	if (error != GC_ERR_SUCCESS)
		return error;
	gint64 size = arv_device_get_integer_feature_value(device->arv, "PayloadSize", &problem);
	if (problem != NULL)
		return device_failed(device, problem, "reading the payload size");
	return reply_size(reply, (size_t)size);
}

GC_API DSGetInfo(DS_HANDLE handle, int32_t command, INFO_DATATYPE *type, void *buffer, size_t *size)
{
	FIND(Stream, stream, handle, STREAM);
	Reply reply = {type, buffer, size};
	guint64 completed = 0, failed = 0, missed = 0;
	size_t queued = 0;

	/* Asking the camera takes time: not under the lock. */
	if (command == STREAM_INFO_PAYLOAD_SIZE)
		return reply_payload_size(stream, reply);
	g_mutex_lock(&stream->lock);
	uint64_t delivered = stream->delivered, started = stream->started;
	size_t announced = stream->buffers->len, waiting = stream->output.length;
	gboolean grabbing = stream->arv != NULL;
	for (guint i = 0; i < announced; i++)
		queued += ((Buffer *)stream->buffers->pdata[i])->state == QUEUED;
	if (grabbing)
		arv_stream_get_statistics(stream->arv, &completed, &failed, &missed);
	uint64_t underruns = stream->underruns + missed;
	g_mutex_unlock(&stream->lock);

	switch (command) {
	case STREAM_INFO_ID:
		return reply_string(reply, STREAM_ID);
	case STREAM_INFO_NUM_DELIVERED:
		return reply_uint64(reply, delivered);
	case STREAM_INFO_NUM_UNDERRUN:
		return reply_uint64(reply, underruns);
	case STREAM_INFO_NUM_ANNOUNCED:
		return reply_size(reply, announced);
	case STREAM_INFO_NUM_QUEUED:
		return reply_size(reply, queued);
	case STREAM_INFO_NUM_AWAIT_DELIVERY:
		return reply_size(reply, waiting);
	case STREAM_INFO_NUM_STARTED:
		return reply_uint64(reply, started);
	case STREAM_INFO_IS_GRABBING:
		return reply_bool(reply, grabbing);
	case STREAM_INFO_DEFINES_PAYLOADSIZE:
		return reply_bool(reply, TRUE);
	case STREAM_INFO_TLTYPE:
		return reply_string(reply, TL_TYPE);
	case STREAM_INFO_NUM_CHUNKS_MAX:
		return fail(GC_ERR_NOT_AVAILABLE, "the camera does not tell how many chunks it may append");
	case STREAM_INFO_BUF_ANNOUNCE_MIN:
	case STREAM_INFO_BUF_ALIGNMENT:
		return reply_size(reply, 1);
	default:
		return reply_unknown("a stream", command);
	}
}
