/* SPDX-License-Identifier: Apache-2.0
   Writes each address that a process binds into the file SOCKETS_FILE: test_sockets.py. */
#define _GNU_SOURCE
#include <arpa/inet.h>
#include <dlfcn.h>
#include <fcntl.h>
#include <netinet/in.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <unistd.h>

int bind(int fd, const struct sockaddr *address, socklen_t size) {
    int (*real)(int, const struct sockaddr *, socklen_t) = dlsym(RTLD_NEXT, "bind");
    int result = real(fd, address, size);
    const char *file = getenv("SOCKETS_FILE");
    if (result || !file) return result;
    int type = 0;
    socklen_t length = sizeof type;
    getsockopt(fd, SOL_SOCKET, SO_TYPE, &type, &length);
    const char *kind = type == SOCK_STREAM ? "tcp" : "udp";
    char where[256] = "", line[400];
    int written = 0;
    if (address->sa_family == AF_INET) {
        const struct sockaddr_in *v4 = (const struct sockaddr_in *)address;
        inet_ntop(AF_INET, &v4->sin_addr, where, sizeof where);
        if (type == SOCK_DGRAM && !v4->sin_port) strcpy(where, "of a free port");
        written = snprintf(line, sizeof line, "%s %s\n", kind, where);
    } else if (address->sa_family == AF_INET6) {
        inet_ntop(AF_INET6, &((const struct sockaddr_in6 *)address)->sin6_addr, where, sizeof where);
        written = snprintf(line, sizeof line, "%s %s\n", kind, where);
    } else if (address->sa_family == AF_UNIX) {
        const struct sockaddr_un *local = (const struct sockaddr_un *)address;
        int length = (int)(size - offsetof(struct sockaddr_un, sun_path));
        if (length > 0 && !local->sun_path[0]) {
            written = snprintf(line, sizeof line, "unix @%.*s\n", length - 1, local->sun_path + 1);
        } else if (length > 0) {
            /* Who may enter the folder may reach the socket. */
            snprintf(where, sizeof where, "%.*s", length, local->sun_path);
            char *end = strrchr(where, '/');
            struct stat folder = {0};
            if (end) *end = 0;
            stat(end ? where : ".", &folder);
            written = snprintf(line, sizeof line, "unix in %03o\n", folder.st_mode & 0777);
        }
    }
    int log = written > 0 ? open(file, O_WRONLY | O_CREAT | O_APPEND | O_CLOEXEC, 0600) : -1;
    if (log >= 0) {
        if (write(log, line, written) < 0) abort();
        close(log);
    }
    return result;
}
