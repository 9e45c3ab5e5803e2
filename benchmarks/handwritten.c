/* What a person would write for this one case: a Kalman filter with n = 4 states, p = 2 outputs and diagonal R, outputs taken
 * one at a time, missing ones (NaN) passed over; conventional covariance update, symmetric by computing half of it. */
#include <math.h>

enum { n = 4, p = 2 };

double kalman(long T, const double *A, const double *C, const double *Q, const double *R, double *x, double *P, const double *y,
              double *means, double *covariances) {
    double total = 0.0;
    for (long k = 0; k < T; k++) {
        for (int j = 0; j < p; j++) {
            double datum = y[k * p + j], f = R[j * p + j], e = datum, g[n];
            if (isnan(datum)) continue;
            for (int i = 0; i < n; i++) {
                g[i] = 0.0;
                for (int l = 0; l < n; l++) g[i] += P[i * n + l] * C[j * n + l];
                f += C[j * n + i] * g[i];
                e -= C[j * n + i] * x[i];
            }
            double inverse = 1.0 / f;
            for (int i = 0; i < n; i++) {
                x[i] += g[i] * inverse * e;
                for (int l = 0; l <= i; l++) P[i * n + l] = P[l * n + i] = P[i * n + l] - g[i] * g[l] * inverse;
            }
            total -= 0.5 * (log(2.0 * M_PI * f) + e * e * inverse);
        }
        for (int i = 0; i < n; i++) means[k * n + i] = x[i];
        for (int i = 0; i < n * n; i++) covariances[k * n * n + i] = P[i];
        double AP[n * n], next[n];
        for (int i = 0; i < n; i++) {
            next[i] = 0.0;
            for (int l = 0; l < n; l++) {
                next[i] += A[i * n + l] * x[l];
                AP[i * n + l] = 0.0;
                for (int h = 0; h < n; h++) AP[i * n + l] += A[i * n + h] * P[h * n + l];
            }
        }
        for (int i = 0; i < n; i++) {
            x[i] = next[i];
            for (int l = 0; l <= i; l++) {
                double sum = Q[i * n + l];
                for (int h = 0; h < n; h++) sum += AP[i * n + h] * A[l * n + h];
                P[i * n + l] = P[l * n + i] = sum;
            }
        }
    }
    return total;
}
