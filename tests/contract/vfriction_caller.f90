! A caller of the user friction routine of client/examples/vfriction.f90, in place of the commercial code that it is written
! for: two elastic half-spaces slide on each other at ten nodes of two interactions, in central differences with the penalty
! of general contact (the stick force is that of a spring), by blocks of four contact points in changing order. The jump has
! its exact value where the friction is constant; where it depends on the heat, the stress is compared with that of a session
! in far-field form, whose inputs the routine never sees. One node leaves its contact and comes back, one begins late.
!
!   vfriction_caller SCENE.toml exact|heat [first|second]
!
! SHEARBUS_SCENE names the scene for the routine, too. first: the host writes its restart file after step 46 and dies;
! second: another process goes on from there. Both make no comparison; second prints what a whole run prints.
program vfriction_caller
  use, intrinsic :: iso_fortran_env, only: real64
  use friction_host
  use shearbus
  implicit none
  integer, parameter :: late = 3, begins = 6, block_size = 4
  real(real64), parameter :: spring = half_mass(soft)/dt**2, along(3) = [0.6_real64, 0.8_real64, 0.0_real64]
  character(len=80), parameter :: interactions(pairs) = [character(len=80) :: 'TOP', 'SIDE']
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
        call ask(p, touching(k:min(k + block_size - 1, n_touching)))
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
    if (t == dumped) call end_of(4, t, time, step_dt)
    if (t == dumped .and. part == 'first') then
      open (newunit=unit, file='host.dump', form='unformatted', status='replace')
      write (unit) v, s, state, applied, time
      close (unit)
      stop
    end if
  end do
  call end_of(6, steps, time, step_dt)

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

  ! Calls the routine for a block of contact points.
  subroutine ask(pair, points)
    integer, intent(in) :: pair, points(:)
    interface
      subroutine vfriction(fTangential, state, nBlock, nBlockAnal, nBlockEdge, nNodState, nNodSec, nNodMain, nFricDir, nDir, &
                           nStates, nProps, nTemp, nFields, jFlags, rData, surfInt, surfSec, surfMain, jConSecUid, &
                           jConMainUid, props, dSlipFric, fStickForce, fTangPrev, fNormal, areaCont, dircosN, dircosSl, &
                           shapeSec, shapeMain, coordSec, coordMain, velSec, velMain, tempSec, tempMain, fieldSec, fieldMain)
        import
        integer, intent(in) :: nBlock, nBlockAnal, nBlockEdge, nNodState, nNodSec, nNodMain, nFricDir, nDir, nStates, nProps
        integer, intent(in) :: nTemp, nFields, jFlags(3), jConSecUid(nNodSec, nBlock), jConMainUid(nNodMain, nBlockAnal)
        real(real64), intent(out) :: fTangential(nFricDir, nBlock)
        real(real64), intent(inout) :: state(nStates, nNodState, nBlock)
        real(real64), intent(in) :: rData(4), props(nProps), dSlipFric(nDir, nBlock), fStickForce(nBlock)
        real(real64), intent(in) :: fTangPrev(nDir, nBlock), fNormal(nBlock), areaCont(nBlock), dircosN(nDir, nBlock)
        real(real64), intent(in) :: dircosSl(nDir, nBlock), shapeSec(nNodSec, nBlockEdge), shapeMain(nNodMain, nBlockAnal)
        real(real64), intent(in) :: coordSec(nDir, nNodSec, nBlock), coordMain(nDir, nNodMain, nBlockAnal)
        real(real64), intent(in) :: velSec(nDir, nNodSec, nBlock), velMain(nDir, nNodMain, nBlockAnal), tempSec(nBlock)
        real(real64), intent(in) :: tempMain(nBlockAnal), fieldSec(nFields, nBlock), fieldMain(nFields, nBlockAnal)
        character(len=80), intent(in) :: surfInt, surfSec, surfMain
      end subroutine
    end interface
    real(real64) :: force(2, size(points)), states(8, 1, size(points)), slip(3, size(points)), stick(size(points))
    real(real64) :: normal(size(points)), areas(size(points)), directions(3, size(points)), none(3, 4, size(points))
    integer :: uid(1, size(points)), main(4, size(points)), i, m
    character(len=80) :: blank
    m = size(points)
    blank = ''
    none = 0
    main = 0
    areas = area
    do i = 1, m
      uid(1, i) = ids(points(i), pair)
      states(:, 1, i) = state(:, points(i), pair)
      slip(:, i) = before(points(i))*step_dt*along
      stick(i) = area*(applied(points(i), pair) + spring*before(points(i))*step_dt)  ! an elastic spring that has slipped before
      normal(i) = area*pressure(points(i))
      directions(:, i) = along
    end do
    call vfriction(force, states, m, m, 1, 1, 1, 4, 2, 3, 8, 2, 1, 1, [1, t, 1], [time, time, step_dt, 0.0_real64], &
                   interactions(pair), blank, blank, uid, main, half_mass, slip, stick, none(:, 1, :), normal, areas, &
                   none(:, 1, :), directions, none(:1, :1, 1), none(1, :, :), none(:, :1, :), none, none(:, :1, :), none, normal, &
                   normal, none(:1, 1, :), none(:1, 1, :))
    do i = 1, m
      if (force(1, i) < -stick(i) .or. force(1, i) > 0 .or. abs(force(2, i)) > 0) call fault('a force out of its range', t, pair, i)
      stress(points(i)) = -force(1, i)/area
      state(:, points(i), pair) = states(:, 1, i)
    end do
  end subroutine
end program
