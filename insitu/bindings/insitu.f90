! Render the members of an ensemble from a simulation in Fortran; see insitu.h.
! Every function returns 0, or 1 where it failed, and insitu_error() says why.
module insitu
  use, intrinsic :: iso_c_binding
  use, intrinsic :: ieee_arithmetic, only: ieee_value, ieee_quiet_nan
  implicit none
  private
  public :: insitu_initialize, insitu_set_parameter, insitu_set_grid, insitu_set_ghosts, insitu_set_field
  public :: insitu_render, insitu_has, insitu_finalize, insitu_error

  interface insitu_set_field
    module procedure set_field_single, set_field_double, set_field_integer, set_field_long
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
      import; type(c_ptr), value :: spacing, origin
    end function
    integer(c_int) function c_set_ghosts(layers) bind(c, name="insitu_set_ghosts")
      import; type(c_ptr), value :: layers
    end function
    integer(c_int) function c_copy_field(name, values, kind, counts, strides) bind(c, name="insitu_copy_field")
      import; character(kind=c_char), intent(in) :: name(*)
      type(c_ptr), value :: values
      integer(c_int), value :: kind
      integer(c_int), intent(in) :: counts(3)
      integer(c_long_long), intent(in) :: strides(3)
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
      insitu_initialize = c_initialize_mpi(trim(scene) // c_null_char, trim(catalog) // c_null_char, int(communicator, c_int))
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
    real(c_double), intent(in) :: spacing(:), origin(:)
    real(c_double), target :: steps(3), place(3)
    if (size(spacing) == 3) steps = spacing
    if (size(origin) == 3) place = origin
    insitu_set_grid = c_set_grid(three(c_loc(steps), size(spacing)), three(c_loc(place), size(origin)))
  end function

  integer function insitu_set_ghosts(layers)
    integer, intent(in) :: layers(:)
    integer(c_int), target :: numbers(3)
    if (size(layers) == 3) numbers = int(layers, c_int)
    insitu_set_ghosts = c_set_ghosts(three(c_loc(numbers), size(layers)))
  end function

  ! values(x, y, z) are copied: parts of arrays, such as u(2:n-1, 2:m-1, 2:l-1), and expressions are welcome.
  integer function set_field_single(name, values) result(status)
    character(*), intent(in) :: name
    real(c_float), intent(in), target :: values(:, :, :)
    type(c_ptr) :: places(4)
    integer :: next(3)
    places = c_null_ptr
    next = min(2, shape(values))
    if (all(next > 0)) places = [c_loc(values(1, 1, 1)), c_loc(values(next(1), 1, 1)), c_loc(values(1, next(2), 1)), &
                                 c_loc(values(1, 1, next(3)))]
    status = copied(name, places, 1, shape(values))
  end function

  integer function set_field_double(name, values) result(status)
    character(*), intent(in) :: name
    real(c_double), intent(in), target :: values(:, :, :)
    type(c_ptr) :: places(4)
    integer :: next(3)
    places = c_null_ptr
    next = min(2, shape(values))
    if (all(next > 0)) places = [c_loc(values(1, 1, 1)), c_loc(values(next(1), 1, 1)), c_loc(values(1, next(2), 1)), &
                                 c_loc(values(1, 1, next(3)))]
    status = copied(name, places, 2, shape(values))
  end function

  integer function set_field_integer(name, values) result(status)
    character(*), intent(in) :: name
    integer(c_int), intent(in), target :: values(:, :, :)
    type(c_ptr) :: places(4)
    integer :: next(3)
    places = c_null_ptr
    next = min(2, shape(values))
    if (all(next > 0)) places = [c_loc(values(1, 1, 1)), c_loc(values(next(1), 1, 1)), c_loc(values(1, next(2), 1)), &
                                 c_loc(values(1, 1, next(3)))]
    status = copied(name, places, 3, shape(values))
  end function

  integer function set_field_long(name, values) result(status)
    character(*), intent(in) :: name
    integer(c_long_long), intent(in), target :: values(:, :, :)
    type(c_ptr) :: places(4)
    integer :: next(3)
    places = c_null_ptr
    next = min(2, shape(values))
    if (all(next > 0)) places = [c_loc(values(1, 1, 1)), c_loc(values(next(1), 1, 1)), c_loc(values(1, next(2), 1)), &
                                 c_loc(values(1, 1, next(3)))]
    status = copied(name, places, 4, shape(values))
  end function

  ! places: of the first sample, and of the next ones along x, y, z.
  integer function copied(name, places, kind, counts)
    character(*), intent(in) :: name
    type(c_ptr), intent(in) :: places(4)
    integer, intent(in) :: kind, counts(3)
    integer(c_intptr_t) :: addresses(4)
    integer :: i
    do i = 1, 4
      addresses(i) = transfer(places(i), addresses(i))
    end do
    copied = c_copy_field(trim(name) // c_null_char, places(1), int(kind, c_int), int(counts, c_int), &
                          int(addresses(2:) - addresses(1), c_long_long))
  end function

  ! The address of three numbers; of more or fewer none, which the library refuses.
  type(c_ptr) function three(place, count)
    type(c_ptr), intent(in) :: place
    integer, intent(in) :: count
    three = merge(place, c_null_ptr, count == 3)
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
