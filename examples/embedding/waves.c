/* Standing waves in a box, rendered while they are computed.  With MPI (-DWITH_MPI, mpicc) each rank has a slab of the box. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#include "insitu.h"
#ifdef WITH_MPI
#include <mpi.h>
#endif

#define SAMPLES 24
#define DUMPS 2

static void check(int failed) {
  if (failed) {
    fprintf(stderr, "waves: %s\n", insitu_error());
    exit(1);
  }
}

int main(int argc, char **argv) {
  int rank = 0, ranks = 1;
  if (argc != 3) {
    fprintf(stderr, "usage: waves SCENE CATALOG\n");
    return 2;
  }
#ifdef WITH_MPI
  MPI_Init(&argc, &argv);
  MPI_Comm_rank(MPI_COMM_WORLD, &rank);
  MPI_Comm_size(MPI_COMM_WORLD, &ranks);
  check(insitu_initialize_mpi(argv[1], argv[2], (int)MPI_Comm_c2f(MPI_COMM_WORLD)));
#else
  check(insitu_initialize(argv[1], argv[2]));
#endif
  const int first = SAMPLES * rank / ranks, after = SAMPLES * (rank + 1) / ranks;
  const int shape[3] = {SAMPLES, SAMPLES, after - first};
  const double step = 2.0 / (SAMPLES - 1), k = 2.0;
  const double spacing[3] = {step, step, step}, origin[3] = {-1.0, -1.0, -1.0 + first * step};
  double *values = malloc(sizeof(double) * SAMPLES * SAMPLES * (after - first));
  check(insitu_set_parameter("k", k));
  check(insitu_set_grid(spacing, origin));
  for (int dump = 0; dump < DUMPS; ++dump) {
    const double time = 0.5 * dump;
    double *value = values;
    for (int i = first; i < after; ++i)
      for (int j = 0; j < SAMPLES; ++j)
        for (int l = 0; l < SAMPLES; ++l)
          *value++ = cos(k * (l * step - 1.0)) * sin(k * (j * step - 1.0) + time) * cos(k * (i * step - 1.0));
    check(insitu_set_field_double("", values, shape));
    check(insitu_render(time));
  }
  check(insitu_finalize());
  free(values);
#ifdef WITH_MPI
  MPI_Finalize();
#endif
  if (rank == 0) printf("%d members\n", DUMPS);
  return 0;
}
