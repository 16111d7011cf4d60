! Solver programs in Fortran 2003 for Ripstop: the functions and types of ripstop.h, which describes them one by one.
!
! A program fills a `ripstop_program` with its role and functions (`c_funloc` of a function with `bind(c)`) and calls
! `serve(program, name, effects)`. A function returns 0, or `fault('...')` to end the run with that message.
!
! Arrays of C are stored row by row: `[faces][4]` has the shape (4, faces) here. Node numbers start at 0: add 1 to use them as an index. The
! constants of statistics start at 1, as the arrays of this language do.
!
! roles: from the code
! structure: input [faces][8]: pressure jump and shear traction x, y, z at the start of the window, then at its end, Pa; linear in
! between. Output [canopy nodes][3]: displacement from the unstressed shape, m. Sign: a positive jump (inside minus outside) pushes
! along the area vector of the face. Empty: never: in a stage without a flow the load is that of the scene.
! flow: input empty; with the effect canopy.motion [canopy nodes][3], as the mesh. Output [faces][4]: pressure jump (inside minus
! outside) and shear traction x, y, z summed over both sides, at the end of the window, Pa. Sign: the force on the canopy is jump
! times area vector plus traction times area. Empty: the moved grid is empty where no mesh-mover runs: the canopy is held still, or
! the effect canopy.motion moves it through the flow's own grid.
! mesh: input [canopy nodes][3]: displacement from the unstressed shape at the end of the window, m. Output [grid nodes][6]:
! position, m, and velocity, m/s, in the falling frame at the end of the window. Sign: the velocity is the second-order backward
! difference of the positions, first order in the first window. Empty: never: a mesh-mover runs only where the canopy moves.
! The area vector of a face with the corners a, b, c, d is half of (c - a) x (d - b); triangles repeat their third corner. z points
! up, and the frame falls with the payload: air at rest comes with minus the velocity of the frame. Rows are numbered over the whole
! canopy or grid, from 0; each rank has some of the output's rows and the whole input. No number may be NaN or infinite.
! end of roles
module ripstop
  use, intrinsic :: iso_c_binding
  implicit none
  public

! constants: from the code
  integer(c_int), parameter :: RIPSTOP_CONTRACT = 5
  integer(c_int), parameter :: RIPSTOP_STATS = 48
  integer(c_int), parameter :: RIPSTOP_ROLE_STRUCTURE = 1
  integer(c_int), parameter :: RIPSTOP_ROLE_FLOW = 2
  integer(c_int), parameter :: RIPSTOP_ROLE_MESH = 3
  integer(c_int), parameter :: RIPSTOP_STRUCTURE_KINETIC_ENERGY = 1  ! J
  integer(c_int), parameter :: RIPSTOP_STRUCTURE_STRAIN_ENERGY = 2  ! J
  integer(c_int), parameter :: RIPSTOP_STRUCTURE_LOAD_WORK = 3  ! J
  integer(c_int), parameter :: RIPSTOP_STRUCTURE_NEWTON_STEPS = 4  ! 1
  integer(c_int), parameter :: RIPSTOP_STRUCTURE_GMRES_ITERATIONS = 5  ! 1
  integer(c_int), parameter :: RIPSTOP_STRUCTURE_FACTORISATIONS = 6  ! 1
  integer(c_int), parameter :: RIPSTOP_STRUCTURE_VERTICAL_LOAD = 7  ! N
  integer(c_int), parameter :: RIPSTOP_STRUCTURE_PROJECTED_AREA = 8  ! m2
  integer(c_int), parameter :: RIPSTOP_STRUCTURE_MAX_LINE_TENSION = 9  ! N
  integer(c_int), parameter :: RIPSTOP_STRUCTURE_RESIDUAL = 10  ! 1
  integer(c_int), parameter :: RIPSTOP_STRUCTURE_STEP_CUTS = 11  ! 1
  integer(c_int), parameter :: RIPSTOP_STRUCTURE_ASSEMBLY_S = 12  ! s
  integer(c_int), parameter :: RIPSTOP_STRUCTURE_LINEAR_S = 13  ! s
  integer(c_int), parameter :: RIPSTOP_STRUCTURE_RISER_FORCE = 15  ! N
  integer(c_int), parameter :: RIPSTOP_STRUCTURE_VOLUME = 16  ! m3
  integer(c_int), parameter :: RIPSTOP_STRUCTURE_RESIDUAL_TARGET = 17  ! 1
  integer(c_int), parameter :: RIPSTOP_STRUCTURE_UNCONVERGED = 18  ! 1
  integer(c_int), parameter :: RIPSTOP_STRUCTURE_WORK = 19  ! J
  integer(c_int), parameter :: RIPSTOP_STRUCTURE_ENERGY_CREATED = 20  ! J
  integer(c_int), parameter :: RIPSTOP_STRUCTURE_WORK_SUM = 21  ! J
  integer(c_int), parameter :: RIPSTOP_STRUCTURE_ENERGY_CREATED_SUM = 22  ! J
  integer(c_int), parameter :: RIPSTOP_STRUCTURE_ENERGY_THROUGHPUT = 23  ! J
  integer(c_int), parameter :: RIPSTOP_STRUCTURE_ENERGY_EXCESS = 24  ! 1
  integer(c_int), parameter :: RIPSTOP_STRUCTURE_MAX_MEMBRANE_FORCE = 27  ! N/m
  integer(c_int), parameter :: RIPSTOP_STRUCTURE_MEMBRANE_FORCE_99 = 28  ! N/m
  integer(c_int), parameter :: RIPSTOP_STRUCTURE_MAX_HEM_TAPE_TENSION = 29  ! N
  integer(c_int), parameter :: RIPSTOP_STRUCTURE_MAX_SEAM_TAPE_TENSION = 30  ! N
  integer(c_int), parameter :: RIPSTOP_STRUCTURE_MAX_VENT_TAPE_TENSION = 31  ! N
  integer(c_int), parameter :: RIPSTOP_STRUCTURE_MAX_GRID_TAPE_TENSION = 32  ! N
  integer(c_int), parameter :: RIPSTOP_STRUCTURE_SUPPORT_FORCE = 33  ! N
  integer(c_int), parameter :: RIPSTOP_STRUCTURE_MOMENTUM = 36  ! N s
  integer(c_int), parameter :: RIPSTOP_STRUCTURE_AIR_FORCE = 39  ! N
  integer(c_int), parameter :: RIPSTOP_STRUCTURE_MEMBRANE_FORCE_OVER_STRENGTH = 42  ! 1
  integer(c_int), parameter :: RIPSTOP_STRUCTURE_MEMBRANE_FORCE_OVER_STRENGTH_99 = 43  ! 1
  integer(c_int), parameter :: RIPSTOP_STRUCTURE_PRESCRIBED_WORK = 44  ! J
  integer(c_int), parameter :: RIPSTOP_STRUCTURE_WAITED_S = 45  ! s
  integer(c_int), parameter :: RIPSTOP_FLOW_FORCE = 1  ! N
  integer(c_int), parameter :: RIPSTOP_FLOW_RESIDUAL_START = 4  ! 1
  integer(c_int), parameter :: RIPSTOP_FLOW_RESIDUAL_END = 5  ! 1
  integer(c_int), parameter :: RIPSTOP_FLOW_ITERATIONS = 6  ! 1
  integer(c_int), parameter :: RIPSTOP_FLOW_LINEAR_ITERATIONS = 7  ! 1
  integer(c_int), parameter :: RIPSTOP_FLOW_MAX_MACH = 8  ! 1
  integer(c_int), parameter :: RIPSTOP_FLOW_MAX_COURANT = 9  ! 1
  integer(c_int), parameter :: RIPSTOP_FLOW_MAX_PRESSURE = 10  ! Pa
  integer(c_int), parameter :: RIPSTOP_FLOW_MIN_PRESSURE = 11  ! Pa
  integer(c_int), parameter :: RIPSTOP_FLOW_MOMENT = 12  ! N m
  integer(c_int), parameter :: RIPSTOP_FLOW_MASS_DEFECT = 15  ! kg/s
  integer(c_int), parameter :: RIPSTOP_FLOW_NO_ANSWER = 16  ! 1
  integer(c_int), parameter :: RIPSTOP_FLOW_RESIDUAL_TARGET = 17  ! 1
  integer(c_int), parameter :: RIPSTOP_FLOW_UNCONVERGED = 18  ! 1
  integer(c_int), parameter :: RIPSTOP_FLOW_TURBULENCE_RESIDUAL = 19  ! 1
  integer(c_int), parameter :: RIPSTOP_FLOW_MAX_MACH_AT = 20  ! 1
  integer(c_int), parameter :: RIPSTOP_FLOW_EXTREME_PRESSURE_AT = 23  ! 1
  integer(c_int), parameter :: RIPSTOP_FLOW_CELL_ERROR = 26  ! 1
  integer(c_int), parameter :: RIPSTOP_FLOW_CELL_ERROR_TARGET = 27  ! 1
  integer(c_int), parameter :: RIPSTOP_FLOW_CELL_ERROR_AT = 28  ! 1
  integer(c_int), parameter :: RIPSTOP_FLOW_WAITED_S = 45  ! s
  integer(c_int), parameter :: RIPSTOP_MESH_MIN_QUALITY = 1  ! 1
  integer(c_int), parameter :: RIPSTOP_MESH_ITERATIONS = 2  ! 1
  integer(c_int), parameter :: RIPSTOP_MESH_INCREMENTS = 3  ! 1
  integer(c_int), parameter :: RIPSTOP_MESH_RESIDUAL = 4  ! 1
  integer(c_int), parameter :: RIPSTOP_MESH_MIN_VOLUME_RATIO = 5  ! 1
  integer(c_int), parameter :: RIPSTOP_MESH_WORST_CELL = 6  ! 1
  integer(c_int), parameter :: RIPSTOP_MESH_STUCK = 7  ! 1
  integer(c_int), parameter :: RIPSTOP_MESH_NEW_GRIDS = 8  ! 1
  integer(c_int), parameter :: RIPSTOP_MESH_NEAREST_NODE = 9  ! 1
  integer(c_int), parameter :: RIPSTOP_MESH_RESIDUAL_TARGET = 10  ! 1
  integer(c_int), parameter :: RIPSTOP_MESH_WAITED_S = 45  ! s
! end of constants

  type, bind(c) :: ripstop_window
    integer(c_int64_t) :: index, iteration, substeps
    real(c_double) :: time, dt
    real(c_double) :: frame_velocity(3), frame_acceleration(3)
  end type

  type, bind(c) :: ripstop_input
    type(c_ptr) :: canopy
    integer(c_size_t) :: canopy_length
    type(c_ptr) :: grid
    integer(c_size_t) :: grid_rows
  end type

  type, bind(c) :: ripstop_structure
    integer(c_size_t) :: nodes
    type(c_ptr) :: coords, fixed, point_mass
    integer(c_size_t) :: canopy_nodes, faces
    type(c_ptr) :: corners
    integer(c_size_t) :: cables
    type(c_ptr) :: cable_ends, cable_length, cable_kind
  end type

  type, bind(c) :: ripstop_grid
    integer(c_size_t) :: nodes
    type(c_ptr) :: coords
    integer(c_size_t) :: cells
    type(c_ptr) :: corners, canopy_nodes
    integer(c_size_t) :: boundary_faces
    type(c_ptr) :: boundary, patch
  end type

  type, bind(c) :: ripstop_program
    integer(c_size_t) :: size = 0
    integer(c_int32_t) :: role = 0, needs_grid = 0
    type(c_ptr) :: name = c_null_ptr, effects = c_null_ptr, user = c_null_ptr
    type(c_funptr) :: start = c_null_funptr, output_rows = c_null_funptr, grid_rows = c_null_funptr
    type(c_funptr) :: advance = c_null_funptr, accept = c_null_funptr, save = c_null_funptr
    type(c_funptr) :: restore = c_null_funptr, snapshot = c_null_funptr
  end type

  interface
    integer(c_int) function ripstop_participant_main(argc, argv, program) bind(c)
      import :: c_int, c_ptr, ripstop_program
      integer(c_int), value :: argc
      type(c_ptr), value :: argv
      type(ripstop_program), intent(in) :: program
    end function

    integer(c_int) function ripstop_fault(message) bind(c)
      import :: c_int, c_char
      character(kind=c_char), intent(in) :: message(*)
    end function

    integer(c_size_t) function ripstop_rank(data) bind(c)
      import :: c_size_t, c_ptr
      type(c_ptr), value :: data
    end function

    integer(c_size_t) function ripstop_ranks(data) bind(c)
      import :: c_size_t, c_ptr
      type(c_ptr), value :: data
    end function

    integer(c_int) function ripstop_share(data, rows, begin, end) bind(c)
      import :: c_int, c_size_t, c_ptr
      type(c_ptr), value :: data
      integer(c_size_t), value :: rows
      integer(c_size_t), intent(out) :: begin, end
    end function

    integer(c_int) function ripstop_is_coupled(data) bind(c)
      import :: c_int, c_ptr
      type(c_ptr), value :: data
    end function

    integer(c_int) function ripstop_get_structure(data, structure) bind(c)
      import :: c_int, c_ptr, ripstop_structure
      type(c_ptr), value :: data
      type(ripstop_structure), intent(out) :: structure
    end function

    integer(c_int) function ripstop_get_grid(data, grid) bind(c)
      import :: c_int, c_ptr, ripstop_grid
      type(c_ptr), value :: data
      type(ripstop_grid), intent(out) :: grid
    end function

    integer(c_int) function ripstop_number(data, key, value) bind(c)
      import :: c_int, c_ptr, c_char, c_double
      type(c_ptr), value :: data
      character(kind=c_char), intent(in) :: key(*)
      real(c_double), intent(inout) :: value
    end function

    integer(c_int) function ripstop_flag(data, key, value) bind(c)
      import :: c_int, c_ptr, c_char
      type(c_ptr), value :: data
      character(kind=c_char), intent(in) :: key(*)
      integer(c_int), intent(inout) :: value
    end function

    integer(c_int) function ripstop_text(data, key, value) bind(c)
      import :: c_int, c_ptr, c_char
      type(c_ptr), value :: data
      character(kind=c_char), intent(in) :: key(*)
      type(c_ptr), intent(inout) :: value
    end function

    integer(c_int) function ripstop_stage_number(data, key, value) bind(c)
      import :: c_int, c_ptr, c_char, c_double
      type(c_ptr), value :: data
      character(kind=c_char), intent(in) :: key(*)
      real(c_double), intent(inout) :: value
    end function

    integer(c_int) function ripstop_clock(data, name, value) bind(c)
      import :: c_int, c_ptr, c_char, c_double
      type(c_ptr), value :: data
      character(kind=c_char), intent(in) :: name(*)
      real(c_double), intent(inout) :: value
    end function

    type(c_ptr) function ripstop_state_file(data, role) bind(c)
      import :: c_ptr, c_int32_t
      type(c_ptr), value :: data
      integer(c_int32_t), value :: role
    end function

    ! `folder` and `file` are those that `save` and `restore` get.
    integer(c_int) function ripstop_save_numbers(data, folder, values, count) bind(c)
      import :: c_int, c_ptr, c_double, c_size_t
      type(c_ptr), value :: data, folder
      real(c_double), intent(in) :: values(*)
      integer(c_size_t), value :: count
    end function

    integer(c_int) function ripstop_load_numbers(file, values, count) bind(c)
      import :: c_int, c_ptr, c_double, c_size_t
      type(c_ptr), value :: file
      real(c_double), intent(inout) :: values(*)
      integer(c_size_t), value :: count
    end function

    integer(c_int) function ripstop_write_shape(folder, positions, nodes) bind(c)
      import :: c_int, c_ptr, c_double, c_size_t
      type(c_ptr), value :: folder
      real(c_double), intent(in) :: positions(3, *)
      integer(c_size_t), value :: nodes
    end function

    integer(c_int) function ripstop_bdf2(ratio, c) bind(c)
      import :: c_int, c_double
      real(c_double), value :: ratio
      real(c_double), intent(out) :: c(3)
    end function
  end interface

contains

  ! Serves the program to the coupler and ends the process with its exit code. `effects` are separated by spaces.
  subroutine serve(program, name, effects)
    type(ripstop_program), intent(inout) :: program
    character(len=*), intent(in) :: name, effects
    character(kind=c_char), target :: name_of_c(len(name) + 1), effects_of_c(len(effects) + 1)
    interface
      subroutine exit_process(code) bind(c, name='exit')
        import :: c_int
        integer(c_int), value :: code
      end subroutine
    end interface
    name_of_c = transfer(name // c_null_char, name_of_c)
    effects_of_c = transfer(effects // c_null_char, effects_of_c)
    program%size = size(transfer(program, [0_c_int8_t]))
    program%name = c_loc(name_of_c(1))
    program%effects = c_loc(effects_of_c(1))
    call exit_process(ripstop_participant_main(0, c_null_ptr, program))
  end subroutine

  ! Keeps the message of an error and returns RIPSTOP_FAULT.
  integer(c_int) function fault(message)
    character(len=*), intent(in) :: message
    fault = ripstop_fault(trim(message) // c_null_char)
  end function

  ! The number at a dotted key of the scene; 0 where it is there, else an error that a caller may ignore.
  integer(c_int) function number(data, key, value)
    type(c_ptr), intent(in) :: data
    character(len=*), intent(in) :: key
    real(c_double), intent(inout) :: value
    number = ripstop_number(data, trim(key) // c_null_char, value)
  end function

  ! The same for a number of the present stage.
  integer(c_int) function stage_number(data, key, value)
    type(c_ptr), intent(in) :: data
    character(len=*), intent(in) :: key
    real(c_double), intent(inout) :: value
    stage_number = ripstop_stage_number(data, trim(key) // c_null_char, value)
  end function

end module
