! A caller of the user friction routine of client/examples/vfric.f90, in place of the commercial code that it is written
! for: two elastic half-spaces slide on each other at ten nodes of two surface pairs, in central differences with
! kinematic contact (predict without friction, ask for the friction force, correct). The answers are those of a session
! in far-field form, whose inputs the routine never sees; so is the heat, where the scene has a stress that depends on
! it. One node leaves its contact and comes back: it has cooled since. vfric_caller SCENE.toml exact|heat [first|second];
! SHEARBUS_SCENE names the scene for the routine, too. exact: the scene has constant friction, and the jump its exact
! value. first: the host writes its restart file after step 46 and dies; second: another process goes on from there. Both
! make no comparison; second prints what a whole run prints.
program vfric_caller
  use, intrinsic :: iso_fortran_env, only: real64
  use friction_host
  use shearbus
  implicit none
  real(real64) :: v(0:zones, nodes, 2, pairs), s(0:zones - 1, nodes, 2, pairs), before(nodes), free(nodes), stress(nodes)
  real(real64) :: pressure(nodes), state(4, nodes, pairs), step_dt, time, found
  ! What the routine gets: the touching nodes alone, from the last to the first.
  real(real64) :: force(2, nodes), slip(3, nodes), stick(nodes), normal(nodes), along(3, nodes), areas(nodes)
  integer :: points(nodes), ids(nodes, pairs), n_points, k, n, p, t, unit, begin
  type(shearbus_interface) :: far_field(pairs)
  logical :: open_now
  logical :: compares
  character(len=500) :: scene, check, part
  character(len=80), parameter :: secondary(2) = [character(len=80) :: 'ASSEMBLY_PLATE_TOP', 'ASSEMBLY_PLATE_SIDE']

  call get_command_argument(1, scene)
  call get_command_argument(2, check)
  call get_command_argument(3, part)
  compares = part == ''
  begin = 1
  v(:, :, soft, :) = jump
  v(:, :, hard, :) = 0
  s = 0
  state = 0
  time = 0
  areas = area
  do p = 1, pairs
    ids(:, p) = [(1000*p + 7*n, n=1, nodes)]
    if (.not. compares) cycle
    call open_far_field(far_field(p), scene, ids(:, p))
  end do

  if (part == 'second') then
    open (newunit=unit, file='host.dump', form='unformatted', status='old')
    read (unit) v, s, state, time
    close (unit)
    begin = dumped + 1
  end if

  do t = begin, steps
    step_dt = merge(0.5_real64*dt, dt, t == 1)
    time = time + step_dt
    do p = 1, pairs
      pressure = [(1e8_real64*n/p, n=1, nodes)]
      open_now = p == 1 .and. t >= leaves .and. t < returns
      if (open_now) pressure(lifted) = 0
      before = v(0, :, soft, p) - v(0, :, hard, p)
      free = before + step_dt*(s(0, :, soft, p)/half_mass(soft) + s(0, :, hard, p)/half_mass(hard))
      n_points = 0
      do n = nodes, 1, -1
        if (pressure(n) <= 0) cycle
        n_points = n_points + 1
        points(n_points) = n
        slip(:, n_points) = [free(n)*step_dt, 0.0_real64, 0.0_real64]
        stick(n_points) = area*free(n)/(step_dt*(1/half_mass(soft) + 1/half_mass(hard)))
        normal(n_points) = area*pressure(n)
        along(:, n_points) = [0.6_real64, 0.8_real64, 0.0_real64]
      end do
      call ask(p)
      stress = 0
      do k = 1, n_points
        if (force(1, k) < -stick(k) .or. force(1, k) > 0 .or. abs(force(2, k)) > 0) call fault('a force out of its range', t, p, k)
        stress(points(k)) = -force(1, k)/area
      end do

      if (compares) then
        associate (bus => far_field(p))
          bus%jump = before
          bus%pressure = pressure
          bus%stress_soft = s(0, :, soft, p)
          bus%stress_hard = s(0, :, hard, p)
          if (p == 1 .and. t >= leaves .and. t <= returns) then
            bus%jump(lifted) = merge(0.0_real64, free(lifted), open_now)  ! what stands for the node in the routine's session:
            bus%stress_soft(lifted) = 0                                   ! nothing while it is not named, and then
            bus%stress_hard(lifted) = 0                                   ! the slip rate without friction for the one before
          end if
          call bus%step(step_dt)
          if (any(abs(bus%stress - stress) > 1e-9_real64*abs(bus%stress))) call fault('another stress', t, p, 0)
        end associate
      end if
      call move(v(:, :, :, p), s(:, :, :, p), stress, step_dt)
    end do
    if (t == dumped) then
      call end_of(4, t, time, step_dt)
      if (part == 'first') then
        open (newunit=unit, file='host.dump', form='unformatted', status='replace')
        write (unit) v, s, state, time
        close (unit)
        stop
      end if
    end if
  end do
  call end_of(6, steps, time, step_dt)

  do p = 1, pairs
    do n = 1, nodes
      found = v(0, n, soft, p) - v(0, n, hard, p)
      call check_jump(found, p, n, check == 'exact')
    end do
  end do
  if (faults > 0) error stop 1

contains

  subroutine ask(pair)
    integer, intent(in) :: pair
    interface
      subroutine vfric(fTangential, statev, kStep, kInc, nContact, nFacNod, nSecNod, nMainNod, nFricDir, nDir, nStateVar, &
                       nProps, nTemp, nPred, numDefTfv, jSecUid, jMainUid, jConSecid, jConMainid, timStep, timGlb, dTimCur, &
                       surfInt, surfSec, surfMain, lContType, dSlipFric, fStickForce, fTangPrev, fNormal, frictionWork, &
                       shape, coordSec, coordMain, dirCosSl, dircosN, props, areaSec, tempSec, preDefSec, tempMain, preDefMain)
        import
        integer, intent(in) :: kStep, kInc, nContact, nFacNod, nSecNod, nMainNod, nFricDir, nDir, nStateVar, nProps, nTemp
        integer, intent(in) :: nPred, numDefTfv, jSecUid(nSecNod), jMainUid(nMainNod), jConSecid(nContact)
        integer, intent(in) :: jConMainid(nFacNod, nContact), lContType
        real(real64), intent(out) :: fTangential(nFricDir, nContact)
        real(real64), intent(inout) :: statev(nStateVar, nSecNod)
        real(real64), intent(in) :: timStep, timGlb, dTimCur, dSlipFric(nDir, nContact), fStickForce(nContact)
        real(real64), intent(in) :: fTangPrev(nDir, nContact), fNormal(nContact), frictionWork, shape(nFacNod, nContact)
        real(real64), intent(in) :: coordSec(nDir, nSecNod), coordMain(nDir, nMainNod), dirCosSl(nDir, nContact)
        real(real64), intent(in) :: dircosN(nDir, nContact), props(nProps), areaSec(nSecNod), tempSec(nContact)
        real(real64), intent(in) :: preDefSec(nContact, nPred), tempMain(numDefTfv), preDefMain(numDefTfv, nPred)
        character(len=80), intent(in) :: surfInt, surfSec, surfMain
      end subroutine
    end interface
    integer :: none(1, nodes)
    real(real64) :: unused(3, nodes), of_nodes(3, nodes), shape_of(1, nodes), one(1), nothing(0, 0)
    character(len=80) :: interaction, other
    interaction = 'CONSTANT_FRICTION'
    other = 'ASSEMBLY_TOOL'
    none = 0
    unused = 0
    of_nodes = 0
    shape_of = 1
    one = 0
    call vfric(force, state(:, :, pair), 1, t, n_points, 1, nodes, 1, 2, 3, 4, 1, 0, 0, 1, ids(:, pair), none(:, 1), &
               points(:n_points), none(:, :n_points), time, time, step_dt, interaction, secondary(pair), other, 1, &
               slip(:, :n_points), stick(:n_points), unused(:, :n_points), normal(:n_points), 0.0_real64, &
               shape_of(:, :n_points), of_nodes, unused(:, 1:1), along(:, :n_points), unused(:, :n_points), one, areas, &
               normal(:n_points), nothing, one, nothing)
  end subroutine
end program
