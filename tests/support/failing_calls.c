/* One call of the system that writes below a folder fails: loaded before libc (LD_PRELOAD).
 *
 * `fail_call(k, ...)` lets the k-th such call from now on fail, counted over write, pwrite, fsync,
 * fdatasync, ftruncate, rename, unlink and open of a new file. With `torn` half of what is to be
 * written is written before; with `for_good` all later calls fail, too. `calls_made()` returns how
 * many there were. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <stdarg.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

static char folder[4096];
static long calls, failing;
static int error, is_torn, for_good;

void fail_call(long k, const char *below, int with, int torn, int all_later)
{
	snprintf(folder, sizeof folder, "%s", below);
	calls = 0, failing = k, error = with, is_torn = torn, for_good = all_later;
}

long calls_made(void) { return calls; }

static int is_below(const char *path) { return failing && path && strstr(path, folder); }

static int is_of(int file)
{
	char link[64], path[4096];
	if (!failing)
		return 0;
	snprintf(link, sizeof link, "/proc/self/fd/%d", file);
	ssize_t length = readlink(link, path, sizeof path - 1);
	if (length <= 0)
		return 0;
	path[length] = 0;
	return is_below(path);
}

/* Count a call, and return whether it is to fail. */
static int fails(void)
{
	calls++;
	if (calls != failing && !(for_good && calls > failing))
		return 0;
	errno = error;
	return 1;
}

#define REAL(name) ((__typeof__(name) *)dlsym(RTLD_NEXT, #name))

ssize_t write(int file, const void *bytes, size_t size)
{
	if (is_of(file) && fails()) {
		if (is_torn)
			REAL(write)(file, bytes, size / 2);
		errno = error;
		return -1;
	}
	return REAL(write)(file, bytes, size);
}

#define PWRITE(name, offset_type)                                                 \
	ssize_t name(int file, const void *bytes, size_t size, offset_type place) \
	{                                                                         \
		if (is_of(file) && fails()) {                                     \
			if (is_torn)                                              \
				REAL(name)(file, bytes, size / 2, place);         \
			errno = error;                                            \
			return -1;                                                \
		}                                                                 \
		return REAL(name)(file, bytes, size, place);                      \
	}
PWRITE(pwrite, off_t)
PWRITE(pwrite64, off64_t)

#define ON_FILE(name) \
	int name(int file) { return is_of(file) && fails() ? -1 : REAL(name)(file); }
ON_FILE(fsync)
ON_FILE(fdatasync)

#define TRUNCATE(name, type) \
	int name(int file, type size) { return is_of(file) && fails() ? -1 : REAL(name)(file, size); }
TRUNCATE(ftruncate, off_t)
TRUNCATE(ftruncate64, off64_t)

int rename(const char *from, const char *to)
{
	return is_below(to) && fails() ? -1 : REAL(rename)(from, to);
}

int unlink(const char *path) { return is_below(path) && fails() ? -1 : REAL(unlink)(path); }

#define OPEN(name)                                                           \
	int name(const char *path, int flags, ...)                           \
	{                                                                    \
		va_list rest;                                                \
		va_start(rest, flags);                                       \
		int mode = flags & O_CREAT ? va_arg(rest, int) : 0;          \
		va_end(rest);                                                \
		if (flags & O_CREAT && is_below(path) && fails())            \
			return -1;                                           \
		return REAL(name)(path, flags, mode);                        \
	}
OPEN(open)
OPEN(open64)
