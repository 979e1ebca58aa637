! Standing waves in a box, rendered while they are computed.
program waves
  use insitu
  use, intrinsic :: iso_c_binding, only: c_double
  implicit none
  integer, parameter :: samples = 24, dumps = 2
  real(c_double), parameter :: k = 2.0_c_double, step = 2.0_c_double / (samples - 1)
  real(c_double), target :: values(samples, samples, samples)
  real(c_double) :: time
  character(1024) :: scene, catalog
  integer :: dump, x, y, z

  call get_command_argument(1, scene)
  call get_command_argument(2, catalog)
  call check(insitu_initialize(scene, catalog))
  call check(insitu_set_parameter("k", k))
  call check(insitu_set_grid([step, step, step], [-1.0_c_double, -1.0_c_double, -1.0_c_double]))
  do dump = 0, dumps - 1
    time = 0.5_c_double * dump
    do z = 1, samples
      do y = 1, samples
        do x = 1, samples
          values(x, y, z) = cos(k * ((x - 1) * step - 1)) * sin(k * ((y - 1) * step - 1) + time) * cos(k * ((z - 1) * step - 1))
        end do
      end do
    end do
    call check(insitu_set_field("", values))
    call check(insitu_render(time))
  end do
  call check(insitu_finalize())
  print "(i0, a)", dumps, " members"

contains

  subroutine check(failed)
    integer, intent(in) :: failed
    if (failed /= 0) then
      print "(2a)", "waves: ", insitu_error()
      error stop 1
    end if
  end subroutine
end program waves
