/* What a person would write for the score and Fisher's information of one record: the sensitivity recursion of the conventional
 * Kalman filter, n = 4 states, p = 2 outputs, nothing missing, d directions in A, Q and R (Gupta and Mehra, 1974). */
#include <math.h>
#include <string.h>

enum { n = 4, p = 2, most = 64 };

static void multiply(const double *A, const double *B, double *out, int rows, int inner, int columns, int transposed) {
    for (int i = 0; i < rows; i++)
        for (int j = 0; j < columns; j++) {
            double sum = 0.0;
            for (int h = 0; h < inner; h++) sum += A[i * inner + h] * (transposed ? B[j * inner + h] : B[h * columns + j]);
            out[i * columns + j] = sum;
        }
}

/* dA (d, n, n), dQ (d, n, n), dR (d, p, p); x, P: the belief before the first sample, overwritten. Returns the log-likelihood. */
double score(long T, int d, const double *A, const double *C, const double *Q, const double *R, const double *dA, const double *dQ,
             const double *dR, double *x, double *P, const double *y, double *g, double *H) {
    static double dx[most][n], dP[most][n * n], de[most][p], W[most][p * p];
    double total = 0.0, determinant, V[p * p];
    memset(dx, 0, sizeof dx), memset(dP, 0, sizeof dP);
    memset(g, 0, d * sizeof(double)), memset(H, 0, d * d * sizeof(double));
    for (long k = 0; k < T; k++) {
        double e[p], PC[n * p], S[p * p], K[n * p], KS[n * p], M[n * n], AM[n * n], m[n], Ve[p];
        multiply(P, C, PC, n, n, p, 1);
        multiply(C, PC, S, p, n, p, 0);
        for (int i = 0; i < p * p; i++) S[i] += R[i];
        determinant = S[0] * S[3] - S[1] * S[2];
        V[0] = S[3] / determinant, V[3] = S[0] / determinant, V[1] = V[2] = -S[1] / determinant;
        multiply(PC, V, K, n, p, p, 0);
        for (int j = 0; j < p; j++) {
            e[j] = y[k * p + j];
            for (int i = 0; i < n; i++) e[j] -= C[j * n + i] * x[i];
        }
        multiply(V, e, Ve, p, p, 1, 0);
        total -= 0.5 * (p * log(2 * M_PI) + log(determinant) + e[0] * Ve[0] + e[1] * Ve[1]);
        multiply(K, S, KS, n, p, p, 0);
        multiply(KS, K, M, n, p, n, 1);
        for (int i = 0; i < n * n; i++) M[i] = P[i] - M[i];
        for (int i = 0; i < n; i++) {
            m[i] = x[i];
            for (int j = 0; j < p; j++) m[i] += K[i * p + j] * e[j];
        }
        multiply(A, M, AM, n, n, n, 0);
        for (int a = 0; a < d; a++) {
            double dPC[n * p], dS[p * p], dK[n * p], KdS[n * p], N[n * n], dM[n * n], AdM[n * n], dAM[n * n], one[n * n], dm[n];
            multiply(dP[a], C, dPC, n, n, p, 1);
            multiply(C, dPC, dS, p, n, p, 0);
            for (int i = 0; i < p * p; i++) dS[i] += dR[a * p * p + i];
            multiply(V, dS, W[a], p, p, p, 0);
            for (int j = 0; j < p; j++) {
                de[a][j] = 0.0;
                for (int i = 0; i < n; i++) de[a][j] -= C[j * n + i] * dx[a][i];
            }
            double trace = W[a][0] + W[a][3], square = 0.0, first = 0.0;
            for (int i = 0; i < p; i++) {
                first += de[a][i] * Ve[i];
                for (int j = 0; j < p; j++) square += Ve[i] * dS[i * p + j] * Ve[j];
            }
            g[a] -= first + 0.5 * (trace - square);
            multiply(K, dS, KdS, n, p, p, 0);
            for (int i = 0; i < n * p; i++) dPC[i] -= KdS[i];
            multiply(dPC, V, dK, n, p, p, 0);
            for (int i = 0; i < n; i++) {
                dm[i] = dx[a][i];
                for (int j = 0; j < p; j++) dm[i] += dK[i * p + j] * e[j] + K[i * p + j] * de[a][j];
            }
            multiply(dK, KS, N, n, p, n, 1);
            multiply(KdS, K, dM, n, p, n, 1);
            for (int i = 0; i < n; i++)
                for (int j = 0; j < n; j++) one[i * n + j] = dP[a][i * n + j] - dM[i * n + j] - N[i * n + j] - N[j * n + i];
            multiply(A, one, AdM, n, n, n, 0);
            multiply(AdM, A, dM, n, n, n, 1);
            multiply(dA + a * n * n, M, dAM, n, n, n, 0);
            multiply(dAM, A, N, n, n, n, 1);
            for (int i = 0; i < n; i++) {
                dx[a][i] = 0.0;
                for (int j = 0; j < n; j++) {
                    dx[a][i] += dA[a * n * n + i * n + j] * m[j] + A[i * n + j] * dm[j];
                    dP[a][i * n + j] = dM[i * n + j] + N[i * n + j] + N[j * n + i] + dQ[a * n * n + i * n + j];
                }
            }
        }
        for (int a = 0; a < d; a++)
            for (int b = 0; b <= a; b++) {
                double sum = 0.0;
                for (int i = 0; i < p; i++)
                    for (int j = 0; j < p; j++)
                        sum += de[a][i] * V[i * p + j] * de[b][j] + 0.5 * W[a][i * p + j] * W[b][j * p + i];
                H[a * d + b] += sum;
            }
        double AMA[n * n];
        multiply(AM, A, AMA, n, n, n, 1);
        multiply(A, m, x, n, n, 1, 0);
        for (int i = 0; i < n * n; i++) P[i] = AMA[i] + Q[i];
    }
    for (int a = 0; a < d; a++)
        for (int b = 0; b < a; b++) H[b * d + a] = H[a * d + b];
    return total;
}
