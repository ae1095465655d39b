/* What GenTL lets a producer leave out, and this one does. */
#pragma GCC diagnostic ignored "-Wunused-parameter"
#include "producer.h"

static GC_ERROR no_parts(DS_HANDLE handle, const char *what)
{
	FIND(Stream, stream, handle, STREAM);
	(void)stream;
	return fail(GC_ERR_NOT_IMPLEMENTED, "%s: GigE Vision images come in one piece here", what);
}

GC_API DSGetNumBufferParts(DS_HANDLE stream, BUFFER_HANDLE buffer, uint32_t *count)
{
	return no_parts(stream, "multi-part payloads");
}

GC_API DSGetBufferPartInfo(DS_HANDLE stream, BUFFER_HANDLE buffer, uint32_t part, int32_t command, INFO_DATATYPE *type,
			   void *value, size_t *size)
{
	return no_parts(stream, "multi-part payloads");
}

GC_API DSAnnounceCompositeBuffer(DS_HANDLE stream, size_t count, void **segments, size_t *sizes, void *user,
				 BUFFER_HANDLE *buffer)
{
	return no_parts(stream, "composite buffers");
}

GC_API DSGetNumBufferSegments(DS_HANDLE stream, BUFFER_HANDLE buffer, uint32_t *count)
{
	return no_parts(stream, "composite buffers");
}

GC_API DSGetBufferSegmentInfo(DS_HANDLE stream, BUFFER_HANDLE buffer, uint32_t segment, int32_t command,
			      INFO_DATATYPE *type, void *value, size_t *size)
{
	return no_parts(stream, "composite buffers");
}

GC_API DSGetNumFlows(DS_HANDLE stream, uint32_t *count)
{
	return no_parts(stream, "flows");
}

GC_API DSGetFlowInfo(DS_HANDLE stream, uint32_t flow, int32_t command, INFO_DATATYPE *type, void *value, size_t *size)
{
	return no_parts(stream, "flows");
}
