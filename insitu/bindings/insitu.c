/* The functions of insitu.h: each calls its counterpart in insitu/bindings/library.py and leaves the simulation's process as it was.

   Floating-point traps, rounding and denormals are the default ones meanwhile: Python, VTK and Mesa divide by zero on purpose.  The
   threads that they start inherit this.  Handlers of signals stay the program's: Python would install one for SIGINT.  */
#include <fenv.h>
#include <pthread.h>
#include <signal.h>
#include <string.h>

#include "insitu.h"

#ifndef NSIG
#define NSIG 65
#endif

static pthread_once_t begun = PTHREAD_ONCE_INIT;
static struct sigaction handlers[NSIG];  /* the program's, before Python starts */
static int started_here, unable;

/* Start Python, unless the program has done so: cffi would, too, but end the process where that fails. */
static void begin(void) {
  if (Py_IsInitialized()) return;
  started_here = 1;
  for (int number = 1; number < NSIG; ++number) sigaction(number, NULL, &handlers[number]);
  PyPreConfig before;
  PyPreConfig_InitPythonConfig(&before);
  before.coerce_c_locale = 0;  /* an environment variable of the program */
  PyStatus status = Py_PreInitialize(&before);
  if (!PyStatus_Exception(status)) {
    PyConfig config;
    PyConfig_InitPythonConfig(&config);
    config.install_signal_handlers = config.parse_argv = config.configure_c_stdio = 0;
    status = Py_InitializeFromConfig(&config);
    PyConfig_Clear(&config);
  }
  unable = PyStatus_Exception(status);
  if (!unable) PyEval_SaveThread();
}

static void enter(fenv_t *kept) {
  fegetenv(kept);
  fesetenv(FE_DFL_ENV);
  pthread_once(&begun, begin);
}

/* Called once, by the interpreter, when it has installed its handlers. */
static void insitu_keep_handlers(void) {
  for (int number = 1; started_here && number < NSIG; ++number) {
    struct sigaction now;
    if (sigaction(number, NULL, &now) == 0 && now.sa_handler != handlers[number].sa_handler)
      sigaction(number, &handlers[number], NULL);
  }
}

/* Answers are a status + 2; cffi returns 0 where the interpreter did not start. */
#define CALL(failed, call)              \
  fenv_t kept;                          \
  enter(&kept);                         \
  const int answer = unable ? 0 : call; \
  fesetenv(&kept);                      \
  return answer ? answer - 2 : failed;

int insitu_initialize(const char *scene, const char *catalog) { CALL(1, insitu_python_initialize(scene, catalog, 0, 0)) }

int insitu_initialize_mpi(const char *scene, const char *catalog, int communicator) {
  CALL(1, insitu_python_initialize(scene, catalog, 1, communicator))
}

int insitu_set_parameter(const char *name, double value) { CALL(1, insitu_python_set_parameter(name, value)) }

int insitu_set_grid(const double *spacing, const double *origin) { CALL(1, insitu_python_set_grid(spacing, origin)) }

int insitu_set_ghosts(const int *layers) { CALL(1, insitu_python_set_ghosts(layers)) }

int insitu_set_field(const char *name, const float *values, const int *shape) {
  CALL(1, insitu_python_set_field(name, values, INSITU_FLOAT, shape))
}

int insitu_set_field_double(const char *name, const double *values, const int *shape) {
  CALL(1, insitu_python_set_field(name, values, INSITU_DOUBLE, shape))
}

int insitu_copy_field(const char *name, const void *values, int type, const int *shape, const long long *strides) {
  CALL(1, insitu_python_copy_field(name, values, type, shape, strides))
}

int insitu_render(double time) { CALL(1, insitu_python_render(time)) }

int insitu_has(double time) { CALL(-1, insitu_python_has(time)) }

int insitu_finalize(void) { CALL(1, insitu_python_finalize()) }

const char *insitu_error(void) {
  fenv_t kept;
  enter(&kept);
  const char *text = unable ? NULL : insitu_python_error();
  fesetenv(&kept);
  return text ? text : "the library's Python could not start; standard error says why. Build the library again: insitu library";
}
