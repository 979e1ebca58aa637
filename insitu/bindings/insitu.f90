! Render the members of an ensemble from a simulation in Fortran; see docs/embedding.md and insitu.h.
! Every function returns 0, or 1 where it failed, and insitu_error() says why.
module insitu
  use, intrinsic :: iso_c_binding
  use, intrinsic :: ieee_arithmetic, only: ieee_value, ieee_quiet_nan
  implicit none
  private
  public :: insitu_initialize, insitu_set_parameter, insitu_set_grid, insitu_set_ghosts, insitu_set_field
  public :: insitu_render, insitu_has, insitu_finalize, insitu_error

  interface insitu_set_field
    module procedure set_field_single, set_field_double
  end interface

  interface
    integer(c_int) function c_initialize(scene, catalog) bind(c, name="insitu_initialize")
      import; character(kind=c_char), intent(in) :: scene(*), catalog(*)
    end function
    integer(c_int) function c_initialize_mpi(scene, catalog, communicator) bind(c, name="insitu_initialize_mpi")
      import; character(kind=c_char), intent(in) :: scene(*), catalog(*)
      integer(c_int), value :: communicator
    end function
    integer(c_int) function c_set_parameter(name, number) bind(c, name="insitu_set_parameter")
      import; character(kind=c_char), intent(in) :: name(*)
      real(c_double), value :: number
    end function
    integer(c_int) function c_set_grid(spacing, origin) bind(c, name="insitu_set_grid")
      import; real(c_double), intent(in) :: spacing(3), origin(3)
    end function
    integer(c_int) function c_set_ghosts(layers) bind(c, name="insitu_set_ghosts")
      import; integer(c_int), intent(in) :: layers(3)
    end function
    integer(c_int) function c_set_field(name, values, counts) bind(c, name="insitu_set_field")
      import; character(kind=c_char), intent(in) :: name(*)
      type(c_ptr), value :: values
      integer(c_int), intent(in) :: counts(3)
    end function
    integer(c_int) function c_set_field_double(name, values, counts) bind(c, name="insitu_set_field_double")
      import; character(kind=c_char), intent(in) :: name(*)
      type(c_ptr), value :: values
      integer(c_int), intent(in) :: counts(3)
    end function
    integer(c_int) function c_render(time) bind(c, name="insitu_render")
      import; real(c_double), value :: time
    end function
    integer(c_int) function c_has(time) bind(c, name="insitu_has")
      import; real(c_double), value :: time
    end function
    integer(c_int) function c_finalize() bind(c, name="insitu_finalize")
      import
    end function
    type(c_ptr) function c_error() bind(c, name="insitu_error")
      import
    end function
    integer(c_size_t) function c_length(text) bind(c, name="strlen")
      import; type(c_ptr), value :: text
    end function
  end interface

contains

  ! communicator: of MPI, as mpi and mpif.h have it, or comm%mpi_val of mpi_f08; left out by a program of one process.
  integer function insitu_initialize(scene, catalog, communicator)
    character(*), intent(in) :: scene, catalog
    integer, intent(in), optional :: communicator
    if (present(communicator)) then
      insitu_initialize = c_initialize_mpi(trim(scene) // c_null_char, trim(catalog) // c_null_char, communicator)
    else
      insitu_initialize = c_initialize(trim(scene) // c_null_char, trim(catalog) // c_null_char)
    end if
  end function

  integer function insitu_set_parameter(name, number)
    character(*), intent(in) :: name
    real(c_double), intent(in) :: number
    insitu_set_parameter = c_set_parameter(trim(name) // c_null_char, number)
  end function

  integer function insitu_set_grid(spacing, origin)
    real(c_double), intent(in) :: spacing(3), origin(3)
    insitu_set_grid = c_set_grid(spacing, origin)
  end function

  integer function insitu_set_ghosts(layers)
    integer, intent(in) :: layers(3)
    insitu_set_ghosts = c_set_ghosts(int(layers, c_int))
  end function

  ! values(x, y, z) must not be moved or freed before insitu_render returns.
  integer function set_field_single(name, values)
    character(*), intent(in) :: name
    real(c_float), intent(in), target, contiguous :: values(:, :, :)
    set_field_single = c_set_field(trim(name) // c_null_char, c_loc(values), shape(values, c_int))
  end function

  integer function set_field_double(name, values)
    character(*), intent(in) :: name
    real(c_double), intent(in), target, contiguous :: values(:, :, :)
    set_field_double = c_set_field_double(trim(name) // c_null_char, c_loc(values), shape(values, c_int))
  end function

  integer function insitu_render(time)
    real(c_double), intent(in), optional :: time
    insitu_render = c_render(given(time))
  end function

  integer function insitu_has(time)
    real(c_double), intent(in), optional :: time
    insitu_has = c_has(given(time))
  end function

  integer function insitu_finalize()
    insitu_finalize = c_finalize()
  end function

  function insitu_error() result(text)
    character(:), allocatable :: text
    character(kind=c_char), pointer :: letters(:)
    type(c_ptr) :: found
    integer :: i
    found = c_error()
    call c_f_pointer(found, letters, [int(c_length(found))])
    allocate(character(size(letters)) :: text)
    do i = 1, size(letters)
      text(i:i) = letters(i)
    end do
  end function

  real(c_double) function given(time)
    real(c_double), intent(in), optional :: time
    if (present(time)) then
      given = time
    else
      given = ieee_value(1.0_c_double, ieee_quiet_nan)
    end if
  end function
end module insitu
