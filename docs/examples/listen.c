/* Read a stream of a running graph from C:   cc listen.c -lzmq -o listen && ./listen ADDRESS STREAM [COUNT]

   ADDRESS is ipc:// and the path of a socket: GROUP.observers in the folder of a run, below $XDG_RUNTIME_DIR/palpate or
   /tmp/palpate-UID. The payload is one msgpack map; this program shows its header fields `tick` and `time`, decoding no
   more of msgpack than they need. For all fields use a msgpack library, such as msgpack-c or mpack. */

#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <zmq.h>

/* The unsigned or signed integer at p. */
static long long integer(const unsigned char *p) {
    unsigned long long value = 0;
    int bytes;
    if (*p < 0x80) return *p;            /* small positive */
    if (*p >= 0xe0) return (signed char)*p;
    bytes = *p >= 0xd0 ? 1 << (*p - 0xd0) : 1 << (*p - 0xcc);
    for (int i = 1; i <= bytes; i++) value = value << 8 | p[i];
    return (long long)value;
}

/* The integer under a key of at most 31 letters; each message begins with the header. */
static long long header(const unsigned char *data, size_t size, const char *key) {
    size_t length = strlen(key);
    for (size_t i = 0; i + length + 1 < size; i++)
        if (data[i] == (0xa0 | length) && memcmp(data + i + 1, key, length) == 0) return integer(data + i + 1 + length);
    return -1;
}

int main(int argc, char **argv) {
    if (argc < 3) return fprintf(stderr, "usage: listen ADDRESS STREAM [COUNT]\n"), 2;
    int count = argc > 3 ? atoi(argv[3]) : -1;
    void *context = zmq_ctx_new(), *socket = zmq_socket(context, ZMQ_SUB);
    zmq_setsockopt(socket, ZMQ_SUBSCRIBE, argv[2], strlen(argv[2]) + 1); /* with the zero byte */
    if (zmq_connect(socket, argv[1])) return fprintf(stderr, "%s: %s\n", argv[1], zmq_strerror(zmq_errno())), 1;
    for (zmq_msg_t frame; count; count -= count > 0) {
        zmq_msg_init(&frame);
        if (zmq_msg_recv(&frame, socket, 0) < 0) return 1;
        const unsigned char *data = zmq_msg_data(&frame);
        size_t size = zmq_msg_size(&frame), topic = strlen((const char *)data) + 1;
        printf("%s tick %lld time %.6f s, %zu bytes\n", (const char *)data, header(data + topic, size - topic, "tick"),
               header(data + topic, size - topic, "time") * 1e-9, size - topic);
        fflush(stdout);
        zmq_msg_close(&frame);
    }
    zmq_close(socket);
    zmq_ctx_term(context);
    return 0;
}
