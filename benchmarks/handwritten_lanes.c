/* What a person would write for a bank of this one case: eight different models side by side, one in each lane of a vector, and
 * the groups of eight shared among threads. Conventional update, outputs taken one at a time, missing ones (NaN) without weight,
 * n = 4 states, p = 2 outputs, diagonal R; only the log-likelihood of each run is kept. */
#include <math.h>
#include <pthread.h>

enum { n = 4, p = 2, lanes = 8 };
typedef double v8 __attribute__((vector_size(8 * lanes)));
typedef long mask __attribute__((vector_size(8 * lanes)));

typedef struct {
    long runs, T, first, stride; /* this thread's groups: first, first + stride, ... */
    const double *A, *C, *Q, *R, *x, *P, *y;
    double *likelihood;
} work;

/* Entry i of the arrays of eight runs; past the last run, that of the last. */
static v8 gather(const double *a, long size, long i, long group, long runs) {
    v8 v;
    for (int l = 0; l < lanes; l++) {
        long run = group * lanes + l;
        v[l] = a[(run < runs ? run : runs - 1) * size + i];
    }
    return v;
}

static v8 where(mask seen, v8 v) { return (v8)(seen & (mask)v); } /* zero elsewhere */

static void correct(const v8 C[n], v8 f, v8 datum, v8 x[n], v8 P[n][n], v8 *size, v8 *squares) {
    v8 g[n], e = datum;
    for (int i = 0; i < n; i++) {
        g[i] = P[i][0] * C[0];
        for (int l = 1; l < n; l++) g[i] += P[i][l] * C[l];
        f += C[i] * g[i];
        e -= C[i] * x[i];
    }
    mask seen = datum == datum;
    v8 weight = where(seen, 1.0 / f);
    e = where(seen, e);
    *size *= 1.0 + where(seen, 2.0 * M_PI * f - 1.0);
    *squares += e * e * weight;
    for (int i = 0; i < n; i++) {
        v8 gain = g[i] * weight;
        x[i] += gain * e;
        for (int l = 0; l <= i; l++) P[i][l] = P[l][i] = P[i][l] - gain * g[l];
    }
}

static void predict(v8 A[n][n], v8 Q[n][n], v8 x[n], v8 P[n][n]) {
    v8 AP[n][n], next[n];
    for (int i = 0; i < n; i++) {
        next[i] = A[i][0] * x[0];
        for (int l = 1; l < n; l++) next[i] += A[i][l] * x[l];
        for (int l = 0; l < n; l++) {
            AP[i][l] = A[i][0] * P[0][l];
            for (int h = 1; h < n; h++) AP[i][l] += A[i][h] * P[h][l];
        }
    }
    for (int i = 0; i < n; i++) {
        x[i] = next[i];
        for (int l = 0; l <= i; l++) {
            v8 sum = Q[i][l];
            for (int h = 0; h < n; h++) sum += AP[i][h] * A[l][h];
            P[i][l] = P[l][i] = sum;
        }
    }
}

static void filter(const work *w, long group) {
    v8 A[n][n], Q[n][n], P[n][n], C[p][n], R[p], x[n], total = {0};
    for (int i = 0; i < n * n; i++) {
        A[i / n][i % n] = gather(w->A, n * n, i, group, w->runs);
        Q[i / n][i % n] = gather(w->Q, n * n, i, group, w->runs);
        P[i / n][i % n] = w->P[i] + total; /* one prior for all */
    }
    for (int i = 0; i < p * n; i++) C[i / n][i % n] = gather(w->C, p * n, i, group, w->runs);
    for (int j = 0; j < p; j++) R[j] = gather(w->R, p * p, j * p + j, group, w->runs);
    for (int i = 0; i < n; i++) x[i] = w->x[i] + total;
    for (long k = 0; k < w->T; k++) {
        v8 size = total * 0.0 + 1.0, squares = {0};
        for (int j = 0; j < p; j++)
            correct(C[j], R[j], gather(w->y, w->T * p, k * p + j, group, w->runs), x, P, &size, &squares);
        for (int l = 0; l < lanes; l++) squares[l] += log(size[l]);
        total -= 0.5 * squares;
        predict(A, Q, x, P);
    }
    for (int l = 0; l < lanes && group * lanes + l < w->runs; l++) w->likelihood[group * lanes + l] = total[l];
}

static void *filter_groups(void *given) {
    const work *w = given;
    for (long group = w->first; group * lanes < w->runs; group += w->stride) filter(w, group);
    return 0;
}

void kalman_bank(long threads, long runs, long T, const double *A, const double *C, const double *Q, const double *R,
                 const double *x, const double *P, const double *y, double *likelihood) {
    work works[threads];
    pthread_t others[threads];
    for (long i = 0; i < threads; i++) {
        works[i] = (work){runs, T, i, threads, A, C, Q, R, x, P, y, likelihood};
        if (i > 0) pthread_create(&others[i], 0, filter_groups, &works[i]);
    }
    filter_groups(&works[0]);
    for (long i = 1; i < threads; i++) pthread_join(others[i], 0);
}
