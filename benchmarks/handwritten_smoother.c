/* What a person would write for this one case: the Rauch-Tung-Striebel smoother of n = 4 states, behind the filter `kalman` of
 * handwritten.c, whose means and covariances it replaces from the last row to the first. Conventional covariances, by a Cholesky
 * factor of the predicted one. */
#include <math.h>

enum { n = 4 };

void rauch(long T, const double *A, const double *Q, double *means, double *covariances) {
    for (long k = T - 2; k >= 0; k--) {
        double *x = means + k * n, *P = covariances + k * n * n, *x1 = x + n, *P1 = P + n * n;
        double AP[n][n], M[n][n], L[n][n], G[n][n], e[n], D[n][n];
        for (int i = 0; i < n; i++) {
            e[i] = x1[i];
            for (int l = 0; l < n; l++) {
                e[i] -= A[i * n + l] * x[l];
                AP[i][l] = 0.0;
                for (int h = 0; h < n; h++) AP[i][l] += A[i * n + h] * P[h * n + l];
            }
        }
        for (int i = 0; i < n; i++)
            for (int l = 0; l <= i; l++) {
                double sum = Q[i * n + l];
                for (int h = 0; h < n; h++) sum += AP[i][h] * A[l * n + h];
                M[i][l] = sum;
                D[i][l] = D[l][i] = P1[i * n + l] - sum;
                for (int h = 0; h < l; h++) sum -= L[i][h] * L[l][h];
                L[i][l] = i == l ? sqrt(sum) : sum / L[l][l];
            }
        for (int c = 0; c < n; c++) { /* row c of the gain: M G' = A P */
            for (int i = 0; i < n; i++) {
                double sum = AP[i][c];
                for (int h = 0; h < i; h++) sum -= L[i][h] * G[c][h];
                G[c][i] = sum / L[i][i];
            }
            for (int i = n - 1; i >= 0; i--) {
                double sum = G[c][i];
                for (int h = i + 1; h < n; h++) sum -= L[h][i] * G[c][h];
                G[c][i] = sum / L[i][i];
            }
        }
        for (int i = 0; i < n; i++) {
            double GD[n];
            for (int l = 0; l < n; l++) {
                x[i] += G[i][l] * e[l];
                GD[l] = 0.0;
                for (int h = 0; h < n; h++) GD[l] += G[i][h] * D[h][l];
            }
            for (int l = 0; l <= i; l++) {
                double sum = P[i * n + l];
                for (int h = 0; h < n; h++) sum += GD[h] * G[l][h];
                P[i * n + l] = P[l * n + i] = sum;
            }
        }
    }
}
