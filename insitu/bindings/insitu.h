/* Render the members of an ensemble from a simulation in C or C++.

   Every function returns 0, or 1 where it failed, and insitu_error() says why.  A call that failed changes nothing, but insitu_render
   forgets the fields in any case.  With MPI all ranks call all of them, in the same order; insitu_initialize_mpi, insitu_render and
   insitu_has fail on all ranks together.  Calls from several threads wait for one another.  Floating-point traps and signal handlers of the program stay as they are. */
#ifndef INSITU_H
#define INSITU_H
#ifdef __cplusplus
extern "C" {
#endif

/* Begin: what a scene file of kind "loop" says goes into the catalog, which may be there already. */
int insitu_initialize(const char *scene, const char *catalog);

/* The same on the ranks of a communicator, of which each has a block of the field: MPI_Comm_c2f(comm).  After MPI_Init. */
int insitu_initialize_mpi(const char *scene, const char *catalog, int communicator);

/* The next member's parameters; they stay for further ones until they are set again. */
int insitu_set_parameter(const char *name, double value);

/* Where samples lie, world units, in the order x, y, z: distance between them, place of the first one; stays. */
int insitu_set_grid(const double *spacing, const double *origin);

/* Layers on every side, x, y, z, that are copies of the neighbours'; stays.  Without this call there are none. */
int insitu_set_ghosts(const int *layers);

/* The next member's values, x fastest, shape[0] * shape[1] * shape[2] for x, y, z.  They are not copied: keep them until
   insitu_render returns.  The name is that by which appearances show the field, "" where they name none. */
int insitu_set_field(const char *name, const float *values, const int *shape);
int insitu_set_field_double(const char *name, const double *values, const int *shape);

/* The same for values that are copied at once and may lie apart, such as the inner part of an array: strides are the bytes from one
   sample to the next along x, y, z, negative ones too; NULL for values side by side, x fastest. */
enum { INSITU_FLOAT = 1, INSITU_DOUBLE = 2, INSITU_INT = 3, INSITU_LONG_LONG = 4 };
int insitu_copy_field(const char *name, const void *values, int type, const int *shape, const long long *strides);

/* Render the member, and forget its fields; one that is in the catalog already is skipped.  A time that is NaN is none. */
int insitu_render(double time);

/* Whether the catalog has a member with the parameters that were set: 1 or 0, -1 where that failed. */
int insitu_has(double time);

int insitu_finalize(void);

/* Why this thread's last call failed, UTF-8; "" where it did not.  Valid until the next call. */
const char *insitu_error(void);

#ifdef __cplusplus
}
#endif
#endif
