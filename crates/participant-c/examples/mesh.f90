! Inverse-distance interpolation in place of the mesh-mover.
!
! Each node of the grid between canopy and outer boundary moves by the mean of their displacements, weighted by (L/r)^3 + (L/r)^5 with
! its distance r to their nodes; the outer boundary stands still. The weights are those of the grid at the start and are kept, one for
! each pair of a free node and a canopy node: for small grids. Every process moves its own share of the nodes.
module inverse_distance
  use ripstop
  implicit none
  private
  public :: start, advance, accept, save_state, restore

  ! Faces of a hexahedron, seen from outside.
  integer, parameter :: sides(4, 6) = reshape( &
    [1, 4, 3, 2, 5, 6, 7, 8, 1, 2, 6, 5, 2, 3, 7, 6, 3, 4, 8, 7, 4, 1, 5, 8], [4, 6])

  type(c_ptr) :: stage                                ! data of the library
  integer :: nodes, canopy_nodes, first, last         ! of the grid; rows of this process
  real(c_double), pointer :: unstressed(:, :)         ! (3, canopy nodes), m
  real(c_double), pointer :: at_start(:, :)           ! (3, nodes), m
  integer(c_int32_t), pointer :: cells(:, :)          ! (8, cells), from 0
  integer, allocatable :: on_canopy(:)                ! grid node of each canopy node
  real(c_double), allocatable :: volumes(:)           ! at the start, m3
  real(c_double), allocatable :: weights(:, :)        ! (canopy nodes, nodes); 0 for nodes that stand still
  ! Positions (m) at the end of the last two windows and of the one that was computed, and the length of the last window (s; 0: none).
  real(c_double), allocatable :: now(:, :), before(:, :), trial(:, :)
  real(c_double) :: last_dt, trial_dt

contains

  integer(c_int) function start(user, data) bind(c)
    type(c_ptr), value :: user, data
    type(ripstop_structure) :: structure
    type(ripstop_grid) :: grid
    integer(c_int32_t), pointer :: boundary(:, :)
    integer(c_int64_t), pointer :: grid_node(:)
    integer(c_size_t) :: begin, end
    integer :: i
    stage = data
    start = ripstop_get_structure(data, structure)
    if (start /= 0) return
    start = ripstop_get_grid(data, grid)
    if (start /= 0) return
    start = ripstop_share(data, grid%nodes, begin, end)
    if (start /= 0) return
    first = int(begin) + 1
    last = int(end)
    nodes = int(grid%nodes)
    canopy_nodes = int(structure%canopy_nodes)
    call c_f_pointer(structure%coords, unstressed, [3, canopy_nodes])
    call c_f_pointer(grid%coords, at_start, [3, nodes])
    call c_f_pointer(grid%corners, cells, [8, int(grid%cells)])
    call c_f_pointer(grid%canopy_nodes, grid_node, [canopy_nodes])
    call c_f_pointer(grid%boundary, boundary, [4, int(grid%boundary_faces)])
    on_canopy = int(grid_node) + 1
    call weigh(boundary)
    allocate (volumes(size(cells, 2)))
    do i = 1, size(cells, 2)
      volumes(i) = volume(cells(:, i), at_start)
    end do
    now = at_start
    before = at_start
    last_dt = 0
  end function

  ! Fills `weights`.
  subroutine weigh(boundary)
    integer(c_int32_t), intent(in) :: boundary(:, :)
    logical :: outer(nodes), canopy(nodes)
    integer, allocatable :: still(:)
    real(c_double) :: length2, total
    integer :: i, j
    outer = .false.
    do j = 1, size(boundary, 2)
      outer(boundary(:, j) + 1) = .true.
    end do
    canopy = .false.
    canopy(on_canopy) = .true.
    still = pack([(i, i = 1, nodes)], outer .and. .not. canopy)
    length2 = 0
    do i = 1, size(still)
      length2 = max(length2, sum((at_start(:, still(i)) - at_start(:, on_canopy(1)))**2))
    end do
    length2 = length2 / 25
    allocate (weights(canopy_nodes, nodes))
    weights = 0
    do i = 1, nodes
      if (outer(i) .or. canopy(i)) cycle
      total = 0
      do j = 1, canopy_nodes
        weights(j, i) = weight(at_start(:, i), at_start(:, on_canopy(j)), length2)
      end do
      do j = 1, size(still)
        total = total + weight(at_start(:, i), at_start(:, still(j)), length2)
      end do
      weights(:, i) = weights(:, i) / (sum(weights(:, i)) + total)
    end do
    do j = 1, canopy_nodes
      weights(j, on_canopy(j)) = 1
    end do
  end subroutine

  pure real(c_double) function weight(a, b, length2)
    real(c_double), intent(in) :: a(3), b(3), length2
    real(c_double) :: s
    s = length2 / max(sum((a - b)**2), 1e-12_c_double * length2)
    weight = s * sqrt(s) + s**2 * sqrt(s)
  end function

  integer(c_int) function advance(user, window, input, output, length, statistics) bind(c)
    type(c_ptr), value :: user
    type(ripstop_window), intent(in) :: window
    type(ripstop_input), intent(in) :: input
    integer(c_size_t), value :: length
    real(c_double), intent(out) :: output(6, length / 6)
    real(c_double), intent(inout) :: statistics(RIPSTOP_STATS)
    real(c_double), pointer :: displacement(:, :)
    real(c_double) :: moved(3, canopy_nodes), c(3), ratio, smallest
    integer :: i, worst
    character(len=300) :: words
    call c_f_pointer(input%canopy, displacement, [3, canopy_nodes])
    moved = unstressed + displacement - at_start(:, on_canopy)
    trial = at_start + matmul(moved, weights)
    smallest = huge(smallest)
    worst = 1
    do i = 1, size(cells, 2)
      ratio = volume(cells(:, i), trial) / volumes(i)
      if (ratio < smallest) then
        smallest = ratio
        worst = i
      end if
    end do
    if (smallest <= 0) then
      write (words, '(a, i0, a, i0, a, f0.3, 2a)') 'cell ', worst - 1, ' is turned inside out in window ', window%index, &
        ' (its volume is ', smallest, ' of that at the start): shorter windows or the project''s own mesh-mover may help'
      advance = fault(words)
      return
    end if
    ! The rate that the flow's time differences have too, so that a uniform stream stays uniform.
    if (last_dt > 0) then
      advance = ripstop_bdf2(window%dt / last_dt, c)
    else
      c = [1, -1, 0]
    end if
    do i = first, last
      output(1:3, i - first + 1) = trial(:, i)
      output(4:6, i - first + 1) = (c(1) * trial(:, i) + c(2) * now(:, i) + c(3) * before(:, i)) / window%dt
    end do
    statistics(RIPSTOP_MESH_MIN_VOLUME_RATIO) = smallest
    statistics(RIPSTOP_MESH_WORST_CELL) = worst - 1
    trial_dt = window%dt
    advance = 0
  end function

  integer(c_int) function accept(user, window) bind(c)
    type(c_ptr), value :: user
    type(ripstop_window), intent(in) :: window
    before = now
    now = trial
    last_dt = trial_dt
    accept = 0
  end function

  integer(c_int) function save_state(user, folder) bind(c, name='inverse_distance_save')
    type(c_ptr), value :: user, folder
    save_state = 0
    if (ripstop_rank(stage) /= 0) return
    save_state = ripstop_save_numbers(stage, folder, [now, before, last_dt], int(6 * nodes + 1, c_size_t))
  end function

  integer(c_int) function restore(user, file) bind(c)
    type(c_ptr), value :: user, file
    real(c_double), allocatable :: values(:)
    allocate (values(6 * nodes + 1))
    restore = ripstop_load_numbers(file, values, size(values, kind=c_size_t))
    if (restore /= 0) return
    now = reshape(values(:3 * nodes), [3, nodes])
    before = reshape(values(3 * nodes + 1:6 * nodes), [3, nodes])
    last_dt = values(6 * nodes + 1)
  end function

  ! Volume of a hexahedron, also of one that repeats nodes, m3.
  pure real(c_double) function volume(cell, x)
    integer(c_int32_t), intent(in) :: cell(8)
    real(c_double), intent(in) :: x(:, :)
    real(c_double) :: corner(3, 4), p(3), q(3), area(3)
    integer :: side
    volume = 0
    do side = 1, 6
      corner = x(:, cell(sides(:, side)) + 1)
      p = corner(:, 3) - corner(:, 1)
      q = corner(:, 4) - corner(:, 2)
      area = [p(2) * q(3) - p(3) * q(2), p(3) * q(1) - p(1) * q(3), p(1) * q(2) - p(2) * q(1)]
      volume = volume + dot_product(sum(corner, 2), area) / 24
    end do
  end function

end module

program main
  use ripstop
  use inverse_distance
  implicit none
  type(ripstop_program) :: mover
  mover%role = RIPSTOP_ROLE_MESH
  mover%start = c_funloc(start)
  mover%advance = c_funloc(advance)
  mover%accept = c_funloc(accept)
  mover%save = c_funloc(save_state)
  mover%restore = c_funloc(restore)
  call serve(mover, 'inverse-distance', 'resume coupling.adaptive')
end program
