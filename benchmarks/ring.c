/* A message of 200 bytes travels around a ring of processes connected by ZeroMQ; prints the median turn [us].
 *
 *   ring PROCESSES TURNS CORE      CORE < 0: not pinned
 *
 * Build: cc -O2 ring.c -o ring -lzmq
 */
#define _GNU_SOURCE
#include <sched.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>
#include <zmq.h>

#define SIZE 200

static int compare(const void *a, const void *b) {
    double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

static double now(void) {
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return t.tv_sec * 1e6 + t.tv_nsec * 1e-3;
}

static void serve(int rank, int count, int turns) {
    char address[64], data[SIZE];
    void *context = zmq_ctx_new();
    void *out = zmq_socket(context, ZMQ_XPUB), *in = zmq_socket(context, ZMQ_SUB);
    snprintf(address, sizeof address, "ipc://@ring-%d-%d", getppid(), rank);
    zmq_bind(out, address);
    snprintf(address, sizeof address, "ipc://@ring-%d-%d", getppid(), (rank + count - 1) % count);
    zmq_connect(in, address);
    zmq_setsockopt(in, ZMQ_SUBSCRIBE, "r", 1);
    zmq_recv(out, data, SIZE, 0); /* wait until the reader subscribes */
    memset(data, 'r', SIZE);
    if (rank > 0) {
        for (int i = 0; i < turns; i++) {
            zmq_recv(in, data, SIZE, 0);
            zmq_send(out, data, SIZE, 0);
        }
    } else {
        double *times = malloc(turns * sizeof *times);
        for (int i = 0; i < turns; i++) {
            double begun = now();
            zmq_send(out, data, SIZE, 0);
            zmq_recv(in, data, SIZE, 0);
            times[i] = now() - begun;
        }
        qsort(times, turns, sizeof *times, compare);
        printf("%.2f\n", times[turns / 2]);
        fflush(stdout);
    }
    zmq_close(in);
    zmq_close(out);
    zmq_ctx_term(context);
}

int main(int argc, char **argv) {
    if (argc != 4) return 2;
    int count = atoi(argv[1]), turns = atoi(argv[2]), core = atoi(argv[3]);
    if (core >= 0) {
        cpu_set_t set;
        CPU_ZERO(&set);
        CPU_SET(core, &set);
        sched_setaffinity(0, sizeof set, &set);
    }
    prctl(PR_SET_TIMERSLACK, 1);
    for (int rank = 0; rank < count; rank++)
        if (fork() == 0) {
            prctl(PR_SET_PDEATHSIG, 9);
            serve(rank, count, turns);
            _exit(0);
        }
    while (wait(NULL) > 0) {
    }
    return 0;
}
