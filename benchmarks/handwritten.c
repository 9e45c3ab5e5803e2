/* What a person would write for this one case: a Kalman filter with n = 4 states, p = 2 outputs and diagonal R, outputs taken
 * one at a time, missing ones (NaN) passed over. `kalman`: conventional covariance update, symmetric by computing half of it.
 * `kalman_ud`: covariances U D U', positive semidefinite by construction as ours (Bierman's update, Thornton's prediction). */
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

double kalman_ud(long T, const double *A, const double *C, const double *W, const double *R, double *x, double *UD, const double *y,
                 double *means, double *covariances) {
    double total = 0.0, U[n][n], D[n];
    for (int i = 0; i < n; i++) {
        for (int j = 0; j < n; j++) U[i][j] = i == j ? 1.0 : i < j ? UD[i * n + j] : 0.0;
        D[i] = UD[i * n + i];
    }
    for (long k = 0; k < T; k++) {
        for (int j = 0; j < p; j++) {
            double datum = y[k * p + j], f = R[j * p + j], e = datum, g[n], v[n], gain[n];
            if (isnan(datum)) continue;
            for (int i = 0; i < n; i++) {
                e -= C[j * n + i] * x[i];
                g[i] = C[j * n + i];
                for (int l = 0; l < i; l++) g[i] += U[l][i] * C[j * n + l];
                v[i] = D[i] * g[i];
            }
            for (int i = 0; i < n; i++) {
                double before = f;
                f += g[i] * v[i];
                D[i] *= before / f;
                double scale = -g[i] / before;
                for (int l = 0; l < i; l++) {
                    double old = U[l][i];
                    U[l][i] = old + gain[l] * scale;
                    gain[l] += old * v[i];
                }
                gain[i] = v[i];
            }
            for (int i = 0; i < n; i++) x[i] += gain[i] * e / f;
            total -= 0.5 * (log(2.0 * M_PI * f) + e * e / f);
        }
        for (int i = 0; i < n; i++) means[k * n + i] = x[i];
        for (int i = 0; i < n; i++)
            for (int j = i; j < n; j++) {
                double sum = 0.0;
                for (int l = j; l < n; l++) sum += U[i][l] * D[l] * U[j][l];
                covariances[k * n * n + i * n + j] = covariances[k * n * n + j * n + i] = sum;
            }
        double N[n][2 * n], weight[2 * n], next[n];
        for (int i = 0; i < n; i++) {
            next[i] = 0.0;
            for (int l = 0; l < n; l++) {
                next[i] += A[i * n + l] * x[l];
                N[i][l] = A[i * n + l];
                for (int h = 0; h < l; h++) N[i][l] += A[i * n + h] * U[h][l];
                N[i][n + l] = W[i * n + l];
            }
            weight[i] = D[i];
            weight[n + i] = 1.0;
        }
        for (int i = 0; i < n; i++) x[i] = next[i];
        for (int j = n - 1; j >= 0; j--) {
            double row[2 * n], size = 0.0;
            for (int l = 0; l < 2 * n; l++) row[l] = weight[l] * N[j][l];
            for (int l = 0; l < 2 * n; l++) size += row[l] * N[j][l];
            D[j] = size;
            for (int i = 0; i < j; i++) {
                double common = 0.0;
                for (int l = 0; l < 2 * n; l++) common += N[i][l] * row[l];
                U[i][j] = common / size;
                for (int l = 0; l < 2 * n; l++) N[i][l] -= U[i][j] * N[j][l];
            }
        }
    }
    return total;
}
