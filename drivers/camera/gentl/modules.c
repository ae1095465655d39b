#include "producer.h"

static GMutex table_lock;
static GHashTable *table;    /* handle -> Module, one reference each */
static uintptr_t last_handle; /* counts up: no handle is given twice */

static void finalize(void *data)
{
	Module *module = data;
	Module *parent = module->parent;

	if (module->class->finalize != NULL)
		module->class->finalize(module);
	g_free(module->id);
	if (parent != NULL)
		module_unref(parent);
}

void *module_new(const ModuleClass *class, void *parent, const char *id)
{
	Module *module = g_atomic_rc_box_alloc0(class->size);

	module->class = class;
	module->parent = parent != NULL ? module_ref(parent) : NULL;
	module->id = g_strdup(id);
	return module;
}

void *module_ref(void *module)
{
	return g_atomic_rc_box_acquire(module);
}

void module_unref(void *module)
{
	g_atomic_rc_box_release_full(module, finalize);
}

/* The lock is held. */
static Module *find_sibling(ModuleKind kind, const void *parent, const char *id)
{
	GHashTableIter iterator;
	void *value;

	if (table == NULL)
		return NULL;
	g_hash_table_iter_init(&iterator, table);
	while (g_hash_table_iter_next(&iterator, NULL, &value)) {
		Module *module = value;
		if ((module->class->kind & kind) && module->parent == parent && g_strcmp0(module->id, id) == 0)
			return module;
	}
	return NULL;
}

GC_ERROR module_publish(void *data)
{
	Module *module = data;
	GC_ERROR error = GC_ERR_SUCCESS;

	g_mutex_lock(&table_lock);
	if (table == NULL)
		table = g_hash_table_new(g_direct_hash, g_direct_equal);
	if (module->id != NULL && find_sibling(module->class->kind, module->parent, module->id) != NULL)
		error = fail(GC_ERR_RESOURCE_IN_USE, "%s is open already", module->id);
	else if (module->parent != NULL && !g_hash_table_contains(table, module->parent->handle))
		error = fail(GC_ERR_INVALID_HANDLE, "what this was opened from was closed meanwhile");
	else {
		module->handle = (void *)++last_handle;
		g_hash_table_insert(table, module->handle, module_ref(module));
	}
	g_mutex_unlock(&table_lock);
	return error;
}

gboolean module_is_open(ModuleKind kind, const void *parent, const char *id)
{
	g_mutex_lock(&table_lock);
	gboolean open = find_sibling(kind, parent, id) != NULL;
	g_mutex_unlock(&table_lock);
	return open;
}

Module *module_child(ModuleKind kind, const void *parent, const char *id)
{
	g_mutex_lock(&table_lock);
	Module *child = find_sibling(kind, parent, id);
	if (child != NULL)
		module_ref(child);
	g_mutex_unlock(&table_lock);
	return child;
}

void *module_find(const void *handle, int kinds, GC_ERROR *error)
{
	if (!library_is_ready()) {
		*error = fail(GC_ERR_NOT_INITIALIZED, "call GCInitLib first");
		return NULL;
	}
	g_mutex_lock(&table_lock);
	Module *module = table != NULL ? g_hash_table_lookup(table, handle) : NULL;
	if (module != NULL && ((int)module->class->kind & kinds))
		module_ref(module);
	else
		module = NULL;
	g_mutex_unlock(&table_lock);
	if (module == NULL)
		*error = fail(GC_ERR_INVALID_HANDLE, "handle %p is not open, or not of the kind asked for", handle);
	return module;
}

/* A reference to any module that was opened from this one (NULL: any that has no parent), or NULL. */
static Module *any_child(const Module *parent)
{
	GHashTableIter iterator;
	void *value;
	Module *child = NULL;

	g_mutex_lock(&table_lock);
	if (table != NULL) {
		g_hash_table_iter_init(&iterator, table);
		while (child == NULL && g_hash_table_iter_next(&iterator, NULL, &value))
			if (((Module *)value)->parent == parent)
				child = module_ref(value);
	}
	g_mutex_unlock(&table_lock);
	return child;
}

void module_close(void *data)
{
	Module *module = data;
	Module *child;

	/* Out of the table first: nothing new can be opened from it. Who removes it closes it. */
	g_mutex_lock(&table_lock);
	gboolean mine = table != NULL && g_hash_table_remove(table, module->handle);
	g_mutex_unlock(&table_lock);
	if (!mine)
		return;
	/* Before its children go: Aravis must not fill buffers that are released. */
	if (module->class->shutdown != NULL)
		module->class->shutdown(module);
	while ((child = any_child(module)) != NULL) {
		module_close(child);
		module_unref(child);
	}
	module_unref(module); /* the table's */
}

GC_ERROR handle_close(const void *handle, ModuleKind kind)
{
	FIND(Module, module, handle, (int)kind);
	module_close(module);
	return GC_ERR_SUCCESS;
}

void modules_close_all(void)
{
	Module *root;

	while ((root = any_child(NULL)) != NULL) {
		module_close(root);
		module_unref(root);
	}
	g_mutex_lock(&table_lock);
	g_clear_pointer(&table, g_hash_table_unref);
	g_mutex_unlock(&table_lock);
}
