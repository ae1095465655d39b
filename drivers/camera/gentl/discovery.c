/* Finding cameras with GigE Vision's DISCOVERY_CMD over our own socket: Aravis' discovery is a broadcast on every
 * interface, this one asks single addresses, or broadcasts on the one interface it was told. */
#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include "producer.h"

#define GVCP_PORT 3956
#define GVCP_KEY 0x42
#define GVCP_ACK_REQUIRED 0x01
#define DISCOVERY_CMD 0x0002
#define DISCOVERY_ACK 0x0003
#define READREG_CMD 0x0080
#define READREG_ACK 0x0081
#define HEADER_SIZE 8
/* The answer repeats the bootstrap registers from address 0. */
#define DISCOVERY_SIZE 248
#define VENDOR 0x048
#define MODEL 0x068
#define VERSION 0x088
#define SERIAL 0x0d8
#define USER_NAME 0x0e8
#define CONTROL_PRIVILEGE 0x0a00
#define STATUS_ACCESS_DENIED 0x8006
#define RESEND_MS 200
#define LONGEST_MS 1000

static gint next_request; /* atomic */

static uint16_t get16(const uint8_t *bytes)
{
	return (uint16_t)(bytes[0] << 8 | bytes[1]);
}

static void put16(uint8_t *bytes, uint16_t value)
{
	bytes[0] = (uint8_t)(value >> 8);
	bytes[1] = (uint8_t)value;
}

/* Request numbers count up and are never 0, as the standard asks. */
static uint16_t new_request(void)
{
	return (uint16_t)(1 + (guint)g_atomic_int_add(&next_request, 1) % 0xffff);
}

static void send_request(int fd, struct in_addr to, uint16_t command, uint16_t number, const void *payload, uint16_t size)
{
	uint8_t packet[HEADER_SIZE + 4] = {GVCP_KEY, GVCP_ACK_REQUIRED};
	struct sockaddr_in address = {.sin_family = AF_INET, .sin_port = htons(GVCP_PORT), .sin_addr = to};

	g_assert(size <= sizeof packet - HEADER_SIZE);
	put16(packet + 2, command);
	put16(packet + 4, size);
	put16(packet + 6, number);
	if (size > 0)
		memcpy(packet + HEADER_SIZE, payload, size);
	/* What cannot be sent is not answered either. */
	(void)!sendto(fd, packet, HEADER_SIZE + size, 0, (struct sockaddr *)&address, sizeof address);
}

/* Wait for the answer to a request until a time (monotonic, us). Gives the payload's size, or -1 when the time is over;
 * packets that are no such answer are passed over. */
static ssize_t receive_answer(int fd, uint16_t answer, uint16_t number, gint64 until, uint8_t *packet, size_t room,
			      struct in_addr *from, uint16_t *status)
{
	for (;;) {
		struct sockaddr_in sender;
		socklen_t length = sizeof sender;
		gint64 left = (until - g_get_monotonic_time() + 999) / 1000;
		struct pollfd waiting = {.fd = fd, .events = POLLIN};

		int arrived = left > 0 ? poll(&waiting, 1, (int)left) : 0;
		if (arrived < 0 && errno == EINTR)
			continue;
		if (arrived <= 0)
			return -1;
		ssize_t size = recvfrom(fd, packet, room, MSG_DONTWAIT, (struct sockaddr *)&sender, &length);
		if (size < HEADER_SIZE || get16(packet + 2) != answer || get16(packet + 6) != number)
			continue;
		*status = get16(packet);
		*from = sender.sin_addr;
		return size - HEADER_SIZE;
	}
}

/* A string register of fixed width, anything but printable ASCII replaced. */
static void copy_text(char *text, const uint8_t *field, size_t width)
{
	memcpy(text, field, width);
	text[width] = '\0';
	for (char *c = text; *c != '\0'; c++)
		if (!g_ascii_isprint(*c))
			*c = '?';
	g_strchomp(text);
}

static CameraInfo *read_camera(const uint8_t *registers, struct in_addr from)
{
	CameraInfo *camera = g_new0(CameraInfo, 1);

	inet_ntop(AF_INET, &from, camera->address, sizeof camera->address);
	copy_text(camera->vendor, registers + VENDOR, sizeof camera->vendor - 1);
	copy_text(camera->model, registers + MODEL, sizeof camera->model - 1);
	copy_text(camera->version, registers + VERSION, sizeof camera->version - 1);
	copy_text(camera->serial, registers + SERIAL, sizeof camera->serial - 1);
	copy_text(camera->user_name, registers + USER_NAME, sizeof camera->user_name - 1);
	/* With the address: simulated cameras, and some cheap ones, share their serial number. */
	g_snprintf(camera->id, sizeof camera->id, "%s-%s-%s@%s", camera->vendor, camera->model, camera->serial,
		   camera->address);
	return camera;
}

/* Whether a camera is free, from its control privilege register. */
static int32_t ask_access(int fd, struct in_addr camera)
{
	uint32_t address = htonl(CONTROL_PRIVILEGE);
	uint8_t packet[HEADER_SIZE + 64];

	for (int attempt = 0; attempt < 2; attempt++) {
		uint16_t number = new_request(), status = 0;
		struct in_addr from;
		send_request(fd, camera, READREG_CMD, number, &address, sizeof address);
		gint64 until = g_get_monotonic_time() + RESEND_MS * 1000;
		ssize_t size = receive_answer(fd, READREG_ACK, number, until, packet, sizeof packet, &from, &status);
		if (size >= 0 && status == STATUS_ACCESS_DENIED)
			return DEVICE_ACCESS_STATUS_NOACCESS;
		if (size >= 4 && status == 0)
			return (packet[HEADER_SIZE + 3] & 0x3) ? DEVICE_ACCESS_STATUS_BUSY :
								  DEVICE_ACCESS_STATUS_READWRITE;
	}
	return DEVICE_ACCESS_STATUS_UNKNOWN;
}

static int open_socket(struct in_addr local, gboolean broadcast)
{
	struct sockaddr_in address = {.sin_family = AF_INET, .sin_addr = local};
	int yes = 1;
	int fd = socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);

	if (fd < 0)
		return -1;
	if ((broadcast && setsockopt(fd, SOL_SOCKET, SO_BROADCAST, &yes, sizeof yes) != 0) ||
	    bind(fd, (struct sockaddr *)&address, sizeof address) != 0) {
		int problem = errno;
		close(fd);
		errno = problem;
		return -1;
	}
	return fd;
}

static gint by_id(gconstpointer one, gconstpointer other)
{
	return strcmp((*(CameraInfo *const *)one)->id, (*(CameraInfo *const *)other)->id);
}

static gboolean is_known(const GPtrArray *cameras, struct in_addr address)
{
	char text[INET_ADDRSTRLEN];

	inet_ntop(AF_INET, &address, text, sizeof text);
	for (guint i = 0; i < cameras->len; i++)
		if (strcmp(((CameraInfo *)cameras->pdata[i])->address, text) == 0)
			return TRUE;
	return FALSE;
}

GPtrArray *discover_cameras(struct in_addr local, const GArray *targets, gboolean broadcast, uint64_t timeout_ms,
			    GC_ERROR *error)
{
	GPtrArray *found = g_ptr_array_new_with_free_func(g_free);
	gint64 now = g_get_monotonic_time();
	gint64 end = now + (gint64)MIN(timeout_ms, LONGEST_MS) * 1000;
	uint16_t number = new_request();
	uint8_t packet[2048];

	int fd = open_socket(local, broadcast);
	if (fd < 0) {
		*error = fail(GC_ERR_IO, "no socket for discovery: %s", g_strerror(errno));
		g_ptr_array_unref(found);
		return NULL;
	}
	do {
		for (guint i = 0; i < targets->len; i++) {
			struct in_addr target = g_array_index(targets, struct in_addr, i);
			if (broadcast || !is_known(found, target))
				send_request(fd, target, DISCOVERY_CMD, number, NULL, 0);
		}
		gint64 until = MIN(end, g_get_monotonic_time() + RESEND_MS * 1000);
		while (broadcast || found->len < targets->len) {
			struct in_addr from;
			uint16_t status;
			ssize_t size =
				receive_answer(fd, DISCOVERY_ACK, number, until, packet, sizeof packet, &from, &status);
			if (size < 0)
				break;
			if (size >= DISCOVERY_SIZE && status == 0 && !is_known(found, from))
				g_ptr_array_add(found, read_camera(packet + HEADER_SIZE, from));
		}
	} while (g_get_monotonic_time() < end && (broadcast || found->len < targets->len));
	for (guint i = 0; i < found->len; i++) {
		CameraInfo *camera = found->pdata[i];
		struct in_addr address;
		inet_pton(AF_INET, camera->address, &address);
		camera->access = ask_access(fd, address);
	}
	close(fd);
	g_ptr_array_sort(found, by_id);
	return found;
}

gboolean local_address_towards(const char *address, char local[INET_ADDRSTRLEN])
{
	struct sockaddr_in there = {.sin_family = AF_INET, .sin_port = htons(GVCP_PORT)}, here = {0};
	socklen_t length = sizeof here;
	gboolean known = FALSE;
	int fd = socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);

	/* Connecting a datagram socket sends nothing; it only makes the kernel choose a route. */
	if (fd >= 0 && inet_pton(AF_INET, address, &there.sin_addr) == 1 &&
	    connect(fd, (struct sockaddr *)&there, sizeof there) == 0 &&
	    getsockname(fd, (struct sockaddr *)&here, &length) == 0)
		known = inet_ntop(AF_INET, &here.sin_addr, local, INET_ADDRSTRLEN) != NULL;
	if (fd >= 0)
		close(fd);
	return known;
}
