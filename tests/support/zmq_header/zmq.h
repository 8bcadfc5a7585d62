/* What docs/examples/listen.c takes of ZeroMQ's header (libzmq 4), for machines that have the library with pyzmq only. */

#pragma once
#include <stddef.h>

typedef struct zmq_msg_t {
    void *_[64 / sizeof(void *)];
} zmq_msg_t;

#define ZMQ_SUB 2
#define ZMQ_SUBSCRIBE 6

void *zmq_ctx_new(void);
int zmq_ctx_term(void *context);
void *zmq_socket(void *context, int type);
int zmq_setsockopt(void *socket, int option, const void *value, size_t size);
int zmq_connect(void *socket, const char *address);
int zmq_close(void *socket);
int zmq_msg_init(zmq_msg_t *message);
int zmq_msg_recv(zmq_msg_t *message, void *socket, int flags);
void *zmq_msg_data(zmq_msg_t *message);
size_t zmq_msg_size(const zmq_msg_t *message);
int zmq_msg_close(zmq_msg_t *message);
int zmq_errno(void);
const char *zmq_strerror(int number);
