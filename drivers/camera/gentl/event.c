/* The one event there is: a new buffer in a stream's output queue, which is the event's own queue as well. */
#include "producer.h"

static Stream *stream_of(Event *event)
{
	return (Stream *)event->module.parent;
}

static void close_event(Module *module)
{
	Event *event = (Event *)module;
	Stream *stream = stream_of(event);

	g_mutex_lock(&stream->lock);
	event->closed = TRUE;
	g_cond_broadcast(&stream->changed);
	g_mutex_unlock(&stream->lock);
}

static const ModuleClass event_class = {.kind = EVENT, .size = sizeof(Event), .shutdown = close_event};

static const char new_buffer_id[] = "new-buffer";

GC_API GCRegisterEvent(EVENTSRC_HANDLE handle, int32_t kind, EVENT_HANDLE *event)
{
	FIND(Module, source, handle, PORTS);
	REQUIRE(event != NULL, "the pointer to the event's handle is NULL");
	if (source->class->kind != STREAM || kind != EVENT_NEW_BUFFER)
		return fail(GC_ERR_NOT_IMPLEMENTED, "%s has no event %d; streams have new buffers (%d)",
			    port_name(source->class->kind), kind, EVENT_NEW_BUFFER);
	g_autoptr(Module) module = module_new(&event_class, source, new_buffer_id);
	GC_ERROR error = module_publish(module);
	if (error == GC_ERR_SUCCESS)
		*event = module->handle;
	return error;
}

GC_API GCUnregisterEvent(EVENTSRC_HANDLE handle, int32_t kind)
{
	FIND(Module, source, handle, PORTS);
	Module *event = kind == EVENT_NEW_BUFFER ? module_child(EVENT, source, new_buffer_id) : NULL;
	if (event == NULL)
		return fail(GC_ERR_INVALID_ID, "event %d is not registered", kind);
	module_close(event);
	module_unref(event);
	return GC_ERR_SUCCESS;
}

/* Wait, with the stream's lock held, until there is a buffer, the event is killed or closed, or the time is over. */
static GC_ERROR wait_for_buffer(Event *event, Stream *stream, uint64_t timeout_ms)
{
	gint64 now = g_get_monotonic_time();
	/* Far enough for "for ever", and too short to overflow. */
	gint64 end = now + (gint64)MIN(timeout_ms, (uint64_t)(G_MAXINT64 / 4000)) * 1000;

	while (!event->closed && event->kills == 0 && stream->output.length == 0)
		if (!g_cond_wait_until(&stream->changed, &stream->lock, end) && stream->output.length == 0 &&
		    event->kills == 0 && !event->closed)
			return fail(GC_ERR_TIMEOUT, "no frame within %" G_GUINT64_FORMAT " ms", timeout_ms);
	if (event->closed)
		return fail(GC_ERR_ABORT, "the event was unregistered");
	if (event->kills > 0) {
		event->kills--;
		return fail(GC_ERR_ABORT, "the wait was killed");
	}
	return GC_ERR_SUCCESS;
}

GC_API EventGetData(EVENT_HANDLE handle, void *data, size_t *size, uint64_t timeout_ms)
{
	FIND(Event, event, handle, EVENT);
	REQUIRE(data == NULL || size != NULL, "the pointer to the buffer's size is NULL");
	Stream *stream = stream_of(event);

	if (data != NULL && *size < sizeof(EVENT_NEW_BUFFER_DATA))
		return fail(GC_ERR_BUFFER_TOO_SMALL, "the event takes %zu bytes, there is room for %zu",
			    sizeof(EVENT_NEW_BUFFER_DATA), *size);
	g_mutex_lock(&stream->lock);
	GC_ERROR error = wait_for_buffer(event, stream, timeout_ms);
	if (error == GC_ERR_SUCCESS) {
		Buffer *buffer = g_queue_pop_head(&stream->output);
		EVENT_NEW_BUFFER_DATA news = {buffer->module.handle, buffer->user};
		buffer->state = HELD;
		stream->delivered++;
		event->fired++;
		if (data != NULL)
			memcpy(data, &news, sizeof news);
		if (size != NULL)
			*size = sizeof news;
	}
	g_mutex_unlock(&stream->lock);
	return error;
}

GC_API EventGetDataInfo(EVENT_HANDLE handle, const void *data, size_t data_size, int32_t command, INFO_DATATYPE *type,
			void *buffer, size_t *size)
{
	FIND(Event, event, handle, EVENT);
	Reply reply = {type, buffer, size};
	EVENT_NEW_BUFFER_DATA news;

	(void)event;
	REQUIRE(data != NULL && data_size >= sizeof news, "that is no data of a new buffer event");
	memcpy(&news, data, sizeof news);
	switch (command) {
	case EVENT_DATA_ID:
		return reply_pointer(reply, news.BufferHandle);
	case EVENT_DATA_VALUE:
		return reply_pointer(reply, news.pUserPointer);
	default:
		return reply_unknown("a new buffer event's data", command);
	}
}

GC_API EventGetInfo(EVENT_HANDLE handle, int32_t command, INFO_DATATYPE *type, void *buffer, size_t *size)
{
	FIND(Event, event, handle, EVENT);
	Reply reply = {type, buffer, size};
	Stream *stream = stream_of(event);

	g_mutex_lock(&stream->lock);
	size_t waiting = stream->output.length;
	uint64_t fired = event->fired;
	g_mutex_unlock(&stream->lock);
	switch (command) {
	case EVENT_EVENT_TYPE:
		return reply_int32(reply, EVENT_NEW_BUFFER);
	case EVENT_NUM_IN_QUEUE:
		return reply_size(reply, waiting);
	case EVENT_NUM_FIRED:
		return reply_uint64(reply, fired);
	case EVENT_SIZE_MAX:
		return reply_size(reply, sizeof(EVENT_NEW_BUFFER_DATA));
	case EVENT_INFO_DATA_SIZE_MAX:
		return reply_size(reply, sizeof(void *));
	default:
		return reply_unknown("an event", command);
	}
}

GC_API EventFlush(EVENT_HANDLE handle)
{
	FIND(Event, event, handle, EVENT);
	Stream *stream = stream_of(event);
	Buffer *buffer;

	g_mutex_lock(&stream->lock);
	while ((buffer = g_queue_pop_head(&stream->output)) != NULL)
		buffer->state = HELD;
	g_mutex_unlock(&stream->lock);
	return GC_ERR_SUCCESS;
}

GC_API EventKill(EVENT_HANDLE handle)
{
	FIND(Event, event, handle, EVENT);
	Stream *stream = stream_of(event);

	g_mutex_lock(&stream->lock);
	event->kills++;
	g_cond_broadcast(&stream->changed);
	g_mutex_unlock(&stream->lock);
	return GC_ERR_SUCCESS;
}
