#define _GNU_SOURCE
#include <dlfcn.h>

#include "producer.h"

static gint ready; /* atomic */

gboolean library_is_ready(void)
{
	return g_atomic_int_get(&ready) != 0;
}

char *library_path(void)
{
	Dl_info info;

	if (dladdr((void *)(uintptr_t)GCInitLib, &info) != 0 && info.dli_fname != NULL)
		return g_canonicalize_filename(info.dli_fname, NULL);
	return g_strdup("polfuse-aravis.cti");
}

GC_API GCInitLib(void)
{
	if (!g_atomic_int_compare_and_exchange(&ready, 0, 1))
		return fail(GC_ERR_RESOURCE_IN_USE, "the producer is initialized already; call GCCloseLib first");
	return GC_ERR_SUCCESS;
}

GC_API GCCloseLib(void)
{
	if (!g_atomic_int_compare_and_exchange(&ready, 1, 0))
		return fail(GC_ERR_NOT_INITIALIZED, "the producer is not initialized");
	modules_close_all();
	return GC_ERR_SUCCESS;
}
