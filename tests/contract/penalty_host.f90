! What the callers of the friction routines for penalty contact share: two elastic half-spaces slide on each other at ten nodes
! of two contacts, in central differences (the stick force is that of a spring), by blocks of four contact points in changing
! order. The jump has its exact value where the friction is constant; where it depends on the heat, the stress is compared with
! that of a session in far-field form, whose inputs the routine never sees. One node leaves its contact and comes back, one
! begins late.
!
!   CALLER SCENE.toml exact|heat [first|second]
!
! SHEARBUS_SCENE names the scene for the routine, too. first: the host writes its restart file after step 46 and dies;
! second: another process goes on from there. Both make no comparison; second prints what a whole run prints.
module penalty_host
  use, intrinsic :: iso_fortran_env, only: real64
  use friction_host
  use shearbus
  implicit none
  private
  public :: run_penalty_host, block_of_points

  ! Contact points of one call, and what the host gives a routine; friction: the size of the force per area that it returns.
  type :: block_of_points
    integer :: pair, step
    real(real64) :: time, dt
    integer, allocatable :: ids(:)
    real(real64), allocatable :: slip(:, :), along(:, :), normal(:, :), stick_force(:), normal_force(:), areas(:), states(:, :)
    real(real64), allocatable :: friction(:)
  end type

  abstract interface
    subroutine friction_routine(points)
      import
      type(block_of_points), intent(inout) :: points
    end subroutine
    ! Tells the routine that the host writes restart files (4) or ends (6), as end_of() of friction_host.
    subroutine end_of_increment(lOp, step, time, step_dt)
      import
      integer, intent(in) :: lOp, step
      real(real64), intent(in) :: time, step_dt
    end subroutine
  end interface

  integer, parameter :: late = 3, begins = 6, block_size = 4
  real(real64), parameter :: spring = half_mass(soft)/dt**2, along(3) = [0.6_real64, 0.8_real64, 0.0_real64]

contains

  subroutine run_penalty_host(ask, told)
    procedure(friction_routine) :: ask
    procedure(end_of_increment) :: told
    real(real64) :: v(0:zones, nodes, 2, pairs), s(0:zones - 1, nodes, 2, pairs), state(8, nodes, pairs), applied(nodes, pairs)
    real(real64) :: last(nodes, pairs)
    real(real64) :: before(nodes), pressure(nodes), stress(nodes), step_dt, time, found, off, largest
    integer :: ids(nodes, pairs), touching(nodes), n_touching, k, n, p, t, unit, begin
    type(shearbus_interface) :: far_field(pairs)
    logical :: compares
    character(len=500) :: scene, check, part

    call get_command_argument(1, scene)
    call get_command_argument(2, check)
    call get_command_argument(3, part)
    compares = part == ''
    begin = 1
    off = 0
    largest = 0
    v(:, :, soft, :) = jump
    v(:, :, hard, :) = 0
    s = 0
    state = 0
    applied = 0
    time = 0
    do p = 1, pairs
      ids(:, p) = [(100000*p + 7*n, n=1, nodes)]
      if (.not. compares) cycle
      call open_far_field(far_field(p), scene, ids(:, p))
    end do
    if (part == 'second') then
      open (newunit=unit, file='host.dump', form='unformatted', status='old')
      read (unit) v, s, state, applied, time
      close (unit)
      begin = dumped + 1
    end if

    do t = begin, steps
      step_dt = merge(0.5_real64*dt, dt, t == 1)
      time = time + step_dt
      do p = 1, pairs
        pressure = [(1e8_real64*n/p, n=1, nodes)]
        if (p == 1 .and. t >= leaves .and. t < returns) pressure(lifted) = 0
        if (p == 2 .and. t < begins) pressure(late) = 0
        before = v(0, :, soft, p) - v(0, :, hard, p)
        last(:, p) = before
        n_touching = 0
        do k = 1, nodes
          n = 1 + modulo(3*k + t, nodes)
          if (pressure(n) <= 0) cycle
          n_touching = n_touching + 1
          touching(n_touching) = n
        end do
        stress = 0
        do k = 1, n_touching, block_size
          call ask_for(p, touching(k:min(k + block_size - 1, n_touching)))
        end do
        where (pressure > 0)
          applied(:, p) = stress
        elsewhere
          applied(:, p) = 0
          state(7, :, p) = 0  ! the code has no state of a contact that is open
        end where
        if (compares) call compare()
        call move(v(:, :, :, p), s(:, :, :, p), stress, step_dt)
      end do
      if (t == dumped) call told(4, t, time, step_dt)
      if (t == dumped .and. part == 'first') then
        open (newunit=unit, file='host.dump', form='unformatted', status='replace')
        write (unit) v, s, state, applied, time
        close (unit)
        stop
      end if
    end do
    call told(6, steps, time, step_dt)

    do p = 1, pairs
      do n = 1, nodes
        found = v(0, n, soft, p) - v(0, n, hard, p)
        if (p == 2 .and. n == late) found = (found + last(n, p))/2  ! a contact that begins with a whole step rings about its jump
        call check_jump(found, p, n, check == 'exact')
      end do
    end do
    if (compares) print '(a,es9.2,a,es9.2)', 'largest difference of a stress from that in far-field form: ', off, &
      ' of itself in the last ten steps, over the run ', largest
    if (check == 'heat' .and. off > 2e-3_real64) call fault('another stress in the last ten steps', steps, 0, 0)
    if (faults > 0) error stop 1

  contains

    ! The stress that the routine's friction had, against that of a session with the inputs of far-field form.
    subroutine compare()
      real(real64) :: difference
      associate (bus => far_field(p))
        bus%jump = before
        bus%pressure = pressure
        bus%stress_soft = s(0, :, soft, p)
        bus%stress_hard = s(0, :, hard, p)
        call bus%step(step_dt)
        difference = maxval(abs(bus%stress - stress)/max(abs(bus%stress), 1e6_real64), mask=pressure > 0)
        if (t > 20) largest = max(largest, difference)
        if (t > steps - 10 .and. t > returns + 1) off = max(off, difference)
      end associate
    end subroutine

    ! Asks the routine for a block of contact points.
    subroutine ask_for(pair, rows)
      integer, intent(in) :: pair, rows(:)
      type(block_of_points) :: points
      integer :: m
      m = size(rows)
      points%pair = pair
      points%step = t
      points%time = time
      points%dt = step_dt
      allocate (points%ids, source=ids(rows, pair))
      allocate (points%states, source=state(:, rows, pair))
      allocate (points%along, source=spread(along, 2, m))
      allocate (points%normal, source=spread([0.0_real64, 0.0_real64, 1.0_real64], 2, m))
      allocate (points%slip, source=spread(before(rows), 1, 3)*points%along)
      allocate (points%areas, source=spread(area, 1, m))
      allocate (points%normal_force, source=area*pressure(rows))
      allocate (points%friction, source=0*points%areas)
      ! an elastic spring that has slipped before
      allocate (points%stick_force, source=area*(applied(rows, pair) + spring*before(rows)*step_dt))
      call ask(points)
      stress(rows) = points%friction
      state(:, rows, pair) = points%states
    end subroutine
  end subroutine
end module
