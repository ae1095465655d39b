#include "producer.h"

/* A chunk ends with its number and its length, four bytes each, big-endian; the last one ends the payload. */
#define CHUNK_TAIL 8

static void finalize(Module *module)
{
	Buffer *buffer = (Buffer *)module;

	g_clear_object(&buffer->arv);
	if (buffer->own_memory)
		g_free(buffer->memory);
}

static const ModuleClass buffer_class = {.kind = BUFFER, .size = sizeof(Buffer), .finalize = finalize};

static GC_ERROR announce(Stream *stream, void *memory, size_t size, gboolean own, void *user, BUFFER_HANDLE *handle)
{
	g_autoptr(Module) module = module_new(&buffer_class, stream, NULL);
	Buffer *buffer = (Buffer *)module;

	buffer->memory = memory;
	buffer->size = size;
	buffer->own_memory = own;
	buffer->user = user;
	buffer->arv = arv_buffer_new_full(size, memory, buffer, NULL);
	g_mutex_lock(&stream->lock);
	GC_ERROR error = module_publish(buffer);
	if (error == GC_ERR_SUCCESS) {
		g_ptr_array_add(stream->buffers, buffer);
		*handle = module->handle;
	}
	g_mutex_unlock(&stream->lock);
	return error;
}

GC_API DSAnnounceBuffer(DS_HANDLE handle, void *memory, size_t size, void *user, BUFFER_HANDLE *buffer)
{
	FIND(Stream, stream, handle, STREAM);
	REQUIRE(memory != NULL && buffer != NULL, "the memory or the pointer to the buffer's handle is NULL");
	REQUIRE(size > 0, "a buffer of no bytes");
	return announce(stream, memory, size, FALSE, user, buffer);
}

GC_API DSAllocAndAnnounceBuffer(DS_HANDLE handle, size_t size, void *user, BUFFER_HANDLE *buffer)
{
	FIND(Stream, stream, handle, STREAM);
	REQUIRE(buffer != NULL, "the pointer to the buffer's handle is NULL");
	REQUIRE(size > 0, "a buffer of no bytes");
	void *memory = g_try_malloc0(size);
	if (memory == NULL)
		return fail(GC_ERR_INVALID_PARAMETER, "%zu bytes are more than there is memory for", size);
	return announce(stream, memory, size, TRUE, user, buffer);
}

GC_ERROR buffer_find(Stream *stream, const void *handle, Buffer **buffer)
{
	GC_ERROR error = GC_ERR_SUCCESS;
	Module *module = module_find(handle, BUFFER, &error);

	if (module != NULL && module->parent == &stream->module) {
		*buffer = (Buffer *)module;
		return GC_ERR_SUCCESS;
	}
	if (module != NULL)
		module_unref(module);
	return fail(GC_ERR_INVALID_BUFFER, "buffer %p is not announced to this stream", handle);
}

/* Declares a referenced buffer of a stream, or returns the error. */
#define FIND_BUFFER(name, stream, handle)                                          \
	Buffer *name = NULL;                                                       \
	GC_ERROR name##_error = buffer_find((stream), (handle), &name);            \
	if (name##_error != GC_ERR_SUCCESS)                                        \
		return name##_error;                                               \
	g_autoptr(Module) name##_module G_GNUC_UNUSED = &name->module

GC_API DSRevokeBuffer(DS_HANDLE handle, BUFFER_HANDLE buffer_handle, void **memory, void **user)
{
	FIND(Stream, stream, handle, STREAM);
	FIND_BUFFER(buffer, stream, buffer_handle);

	g_mutex_lock(&stream->lock);
	gboolean held = buffer->state == HELD;
	if (held)
		g_ptr_array_remove(stream->buffers, buffer);
	g_mutex_unlock(&stream->lock);
	if (!held)
		return fail(GC_ERR_BUSY, "the buffer is queued; flush the queues first");
	if (memory != NULL)
		*memory = buffer->own_memory ? NULL : buffer->memory;
	if (user != NULL)
		*user = buffer->user;
	module_close(buffer);
	return GC_ERR_SUCCESS;
}

GC_API DSQueueBuffer(DS_HANDLE handle, BUFFER_HANDLE buffer_handle)
{
	FIND(Stream, stream, handle, STREAM);
	FIND_BUFFER(buffer, stream, buffer_handle);

	g_mutex_lock(&stream->lock);
	gboolean held = buffer->state == HELD;
	if (held)
		stream_queue(stream, buffer);
	g_mutex_unlock(&stream->lock);
	if (!held)
		return fail(GC_ERR_RESOURCE_IN_USE, "the buffer is queued already");
	return GC_ERR_SUCCESS;
}

GC_API DSGetBufferID(DS_HANDLE handle, uint32_t index, BUFFER_HANDLE *buffer)
{
	FIND(Stream, stream, handle, STREAM);
	REQUIRE(buffer != NULL, "the pointer to the buffer's handle is NULL");
	g_mutex_lock(&stream->lock);
	guint count = stream->buffers->len;
	if (index < count)
		*buffer = ((Buffer *)stream->buffers->pdata[index])->module.handle;
	g_mutex_unlock(&stream->lock);
	if (index >= count)
		return fail(GC_ERR_INVALID_INDEX, "buffer %u of %u", index, count);
	return GC_ERR_SUCCESS;
}

/* Bytes of the image's pixels; a pixel format tells its bits per pixel in its third byte. */
static size_t pixel_bytes(const FrameInfo *frame)
{
	return ((size_t)frame->width * frame->height * (frame->pixel_format >> 16 & 0xff) + 7) / 8;
}

FrameInfo frame_info(ArvBuffer *arv)
{
	ArvBufferStatus status = arv_buffer_get_status(arv);
	FrameInfo frame = {
		.incomplete = status != ARV_BUFFER_STATUS_SUCCESS,
		.too_large = status == ARV_BUFFER_STATUS_SIZE_MISMATCH,
		.payload = arv_buffer_get_payload_type(arv),
		.timestamp_ns = arv_buffer_get_timestamp(arv),
		.frame_id = arv_buffer_get_frame_id(arv),
	};

	arv_buffer_get_data(arv, &frame.filled);
	frame.chunks = !frame.incomplete && arv_buffer_has_chunks(arv);
	/* Of an incomplete frame Aravis tells neither size nor format. */
	if (!frame.incomplete &&
	    (frame.payload == ARV_BUFFER_PAYLOAD_TYPE_IMAGE ||
	     frame.payload == ARV_BUFFER_PAYLOAD_TYPE_EXTENDED_CHUNK_DATA) &&
	    arv_buffer_get_n_parts(arv) > 0 &&
	    arv_buffer_get_part_data_type(arv, 0) == ARV_BUFFER_PART_DATA_TYPE_2D_IMAGE) {
		gint x, y, width, height, x_padding, y_padding;
		arv_buffer_get_part_region(arv, 0, &x, &y, &width, &height);
		arv_buffer_get_part_padding(arv, 0, &x_padding, &y_padding);
		frame.image = TRUE;
		frame.pixel_format = arv_buffer_get_part_pixel_format(arv, 0);
		frame.width = (uint32_t)width;
		frame.height = (uint32_t)height;
		frame.x_offset = (uint32_t)x;
		frame.y_offset = (uint32_t)y;
		frame.x_padding = (uint32_t)x_padding;
		frame.y_padding = (uint32_t)y_padding;
		/* A camera that ends a frame early loses no packet, so Aravis calls it whole. */
		if (frame.filled < pixel_bytes(&frame))
			frame.incomplete = TRUE;
	}
	return frame;
}

static size_t payload_type(const FrameInfo *frame)
{
	switch (frame->payload) {
	case ARV_BUFFER_PAYLOAD_TYPE_IMAGE:
		return frame->chunks ? PAYLOAD_TYPE_CHUNK_DATA : PAYLOAD_TYPE_IMAGE;
	case ARV_BUFFER_PAYLOAD_TYPE_CHUNK_DATA:
	case ARV_BUFFER_PAYLOAD_TYPE_EXTENDED_CHUNK_DATA:
		return frame->image ? PAYLOAD_TYPE_CHUNK_DATA : PAYLOAD_TYPE_CHUNK_ONLY;
	case ARV_BUFFER_PAYLOAD_TYPE_RAWDATA:
		return PAYLOAD_TYPE_RAW_DATA;
	case ARV_BUFFER_PAYLOAD_TYPE_FILE:
		return PAYLOAD_TYPE_FILE;
	case ARV_BUFFER_PAYLOAD_TYPE_JPEG:
		return PAYLOAD_TYPE_JPEG;
	case ARV_BUFFER_PAYLOAD_TYPE_JPEG2000:
		return PAYLOAD_TYPE_JPEG2000;
	case ARV_BUFFER_PAYLOAD_TYPE_H264:
		return PAYLOAD_TYPE_H264;
	default:
		return PAYLOAD_TYPE_UNKNOWN;
	}
}

/* What only an image has. */
static GC_ERROR image_reply(const FrameInfo *frame, int32_t command, Reply reply)
{
	if (!frame->image)
		return fail(GC_ERR_NOT_AVAILABLE, "the buffer holds no image");
	switch (command) {
	case BUFFER_INFO_WIDTH:
		return reply_size(reply, frame->width);
	case BUFFER_INFO_HEIGHT:
	case BUFFER_INFO_DELIVERED_IMAGEHEIGHT:
		return reply_size(reply, frame->height);
	case BUFFER_INFO_XOFFSET:
		return reply_size(reply, frame->x_offset);
	case BUFFER_INFO_YOFFSET:
		return reply_size(reply, frame->y_offset);
	case BUFFER_INFO_XPADDING:
		return reply_size(reply, frame->x_padding);
	case BUFFER_INFO_YPADDING:
		return reply_size(reply, frame->y_padding);
	case BUFFER_INFO_IMAGEOFFSET:
		return reply_size(reply, 0);
	case BUFFER_INFO_PIXELFORMAT:
		return reply_uint64(reply, frame->pixel_format);
	case BUFFER_INFO_PIXELFORMAT_NAMESPACE:
		return reply_uint64(reply, PIXELFORMAT_NAMESPACE_PFNC_32BIT);
	default:
		return reply_int32(reply, PIXELENDIANNESS_LITTLE);
	}
}

GC_API DSGetBufferInfo(DS_HANDLE handle, BUFFER_HANDLE buffer_handle, int32_t command, INFO_DATATYPE *type, void *value,
		       size_t *size)
{
	FIND(Stream, stream, handle, STREAM);
	FIND_BUFFER(buffer, stream, buffer_handle);
	Reply reply = {type, value, size};

	g_mutex_lock(&stream->lock);
	FrameInfo frame = buffer->frame;
	BufferState state = buffer->state;
	gboolean new_data = buffer->new_data, acquiring = stream->arv != NULL && state == QUEUED;
	g_mutex_unlock(&stream->lock);

	switch (command) {
	case BUFFER_INFO_BASE:
		return reply_pointer(reply, buffer->memory);
	case BUFFER_INFO_SIZE:
		return reply_size(reply, buffer->size);
	case BUFFER_INFO_USER_PTR:
		return reply_pointer(reply, buffer->user);
	case BUFFER_INFO_TIMESTAMP:
	case BUFFER_INFO_TIMESTAMP_NS:
		return reply_uint64(reply, frame.timestamp_ns);
	case BUFFER_INFO_NEW_DATA:
		return reply_bool(reply, new_data);
	case BUFFER_INFO_IS_QUEUED:
		return reply_bool(reply, state != HELD);
	case BUFFER_INFO_IS_ACQUIRING:
		return reply_bool(reply, acquiring);
	case BUFFER_INFO_IS_INCOMPLETE:
		return reply_bool(reply, frame.incomplete);
	case BUFFER_INFO_TLTYPE:
		return reply_string(reply, TL_TYPE);
	case BUFFER_INFO_SIZE_FILLED:
	case BUFFER_INFO_DATA_SIZE:
		return reply_size(reply, frame.filled);
	case BUFFER_INFO_FRAMEID:
		return reply_uint64(reply, frame.frame_id);
	case BUFFER_INFO_IMAGEPRESENT:
		return reply_bool(reply, frame.image);
	case BUFFER_INFO_PAYLOADTYPE:
		return reply_size(reply, payload_type(&frame));
	case BUFFER_INFO_DELIVERED_CHUNKPAYLOADSIZE:
		return reply_size(reply, frame.chunks ? frame.filled : 0);
	case BUFFER_INFO_CONTAINS_CHUNKDATA:
		return reply_bool(reply, frame.chunks);
	case BUFFER_INFO_DATA_LARGER_THAN_BUFFER:
		return reply_bool(reply, frame.too_large);
	case BUFFER_INFO_CHUNKLAYOUTID:
	case BUFFER_INFO_FILENAME:
		return fail(GC_ERR_NOT_AVAILABLE, "Aravis does not tell the chunk layout's number or a file's name");
	case BUFFER_INFO_WIDTH:
	case BUFFER_INFO_HEIGHT:
	case BUFFER_INFO_XOFFSET:
	case BUFFER_INFO_YOFFSET:
	case BUFFER_INFO_XPADDING:
	case BUFFER_INFO_YPADDING:
	case BUFFER_INFO_IMAGEOFFSET:
	case BUFFER_INFO_DELIVERED_IMAGEHEIGHT:
	case BUFFER_INFO_PIXELFORMAT:
	case BUFFER_INFO_PIXELFORMAT_NAMESPACE:
	case BUFFER_INFO_PIXEL_ENDIANNESS:
		return image_reply(&frame, command, reply);
	default:
		return reply_unknown("a buffer", command);
	}
}

static uint32_t get32(const uint8_t *bytes)
{
	return (uint32_t)bytes[0] << 24 | (uint32_t)bytes[1] << 16 | (uint32_t)bytes[2] << 8 | bytes[3];
}

/* The chunks of a payload from last to first, as they must be read. NULL where they do not fill it exactly. */
static GArray *parse_chunks(const uint8_t *payload, size_t size)
{
	GArray *chunks = g_array_new(FALSE, FALSE, sizeof(SINGLE_CHUNK_DATA));
	size_t end = size;

	while (end >= CHUNK_TAIL) {
		const uint8_t *tail = payload + end - CHUNK_TAIL;
		size_t length = get32(tail + 4);
		if (length > end - CHUNK_TAIL)
			break;
		end -= CHUNK_TAIL + length;
		SINGLE_CHUNK_DATA chunk = {get32(tail), (ptrdiff_t)end, length};
		g_array_append_val(chunks, chunk);
	}
	if (end != 0)
		g_clear_pointer(&chunks, g_array_unref);
	return chunks;
}

GC_API DSGetBufferChunkData(DS_HANDLE handle, BUFFER_HANDLE buffer_handle, SINGLE_CHUNK_DATA *chunks, size_t *count)
{
	FIND(Stream, stream, handle, STREAM);
	FIND_BUFFER(buffer, stream, buffer_handle);
	REQUIRE(count != NULL, "the pointer to the count is NULL");

	/* Under the lock: the buffer must not be queued, and filled anew, meanwhile. */
	g_mutex_lock(&stream->lock);
	gboolean readable = buffer->state != QUEUED && buffer->new_data && buffer->frame.chunks;
	g_autoptr(GArray) found = readable ? parse_chunks(buffer->memory, buffer->frame.filled) : NULL;
	g_mutex_unlock(&stream->lock);
	if (!readable)
		return fail(GC_ERR_NO_DATA, "the buffer holds no chunks");
	if (found == NULL)
		return fail(GC_ERR_PARSING_CHUNK_DATA, "the chunks' lengths do not add up to the payload");
	size_t room = *count;
	*count = found->len;
	if (chunks == NULL)
		return GC_ERR_SUCCESS;
	if (room < found->len)
		return fail(GC_ERR_BUFFER_TOO_SMALL, "%u chunks, room for %zu", found->len, room);
	for (guint i = 0; i < found->len; i++)
		chunks[i] = g_array_index(found, SINGLE_CHUNK_DATA, found->len - 1 - i);
	return GC_ERR_SUCCESS;
}
