#include "producer.h"

static GC_ERROR reply_bytes(Reply reply, INFO_DATATYPE type, const void *value, size_t size)
{
	if (reply.size == NULL)
		return fail(GC_ERR_INVALID_PARAMETER, "the pointer to the size of the answer is NULL");
	if (reply.type != NULL)
		*reply.type = type;
	size_t room = *reply.size;
	*reply.size = size;
	if (reply.buffer == NULL)
		return GC_ERR_SUCCESS;
	if (room < size)
		return fail(GC_ERR_BUFFER_TOO_SMALL, "the answer takes %zu bytes, there is room for %zu", size, room);
	memcpy(reply.buffer, value, size);
	return GC_ERR_SUCCESS;
}

GC_ERROR reply_string(Reply reply, const char *text)
{
	return reply_bytes(reply, INFO_DATATYPE_STRING, text, strlen(text) + 1);
}

GC_ERROR reply_int32(Reply reply, int32_t value)
{
	return reply_bytes(reply, INFO_DATATYPE_INT32, &value, sizeof value);
}

GC_ERROR reply_uint32(Reply reply, uint32_t value)
{
	return reply_bytes(reply, INFO_DATATYPE_UINT32, &value, sizeof value);
}

GC_ERROR reply_uint64(Reply reply, uint64_t value)
{
	return reply_bytes(reply, INFO_DATATYPE_UINT64, &value, sizeof value);
}

GC_ERROR reply_size(Reply reply, size_t value)
{
	return reply_bytes(reply, INFO_DATATYPE_SIZET, &value, sizeof value);
}

GC_ERROR reply_bool(Reply reply, gboolean value)
{
	bool8_t byte = value ? 1 : 0;

	return reply_bytes(reply, INFO_DATATYPE_BOOL8, &byte, sizeof byte);
}

GC_ERROR reply_pointer(Reply reply, const void *value)
{
	return reply_bytes(reply, INFO_DATATYPE_PTR, &value, sizeof value);
}

GC_ERROR reply_unknown(const char *query, int32_t command)
{
	return fail(GC_ERR_NOT_IMPLEMENTED, "%s has no information number %d", query, command);
}
