! Template of a user friction routine that asks shearbus: VFRICTION of Abaqus/Explicit, for general contact.
!
! Documented by the vendor (user subroutine VFRICTION) and not run here: the list of arguments; that the routine gets the
! contact points of an interaction in blocks, several calls an increment, without names of surfaces; local direction 1
! along the slip of the increment; fStickForce the force that prevents further slip; fTangential(1,:) between -fStickForce
! and 0. Run here: this file, by a caller of our own (tests/contract/vfriction_caller.f90) that solves two half-spaces with
! an exact answer, and restarts.
!
! General contact enforces sticking by a penalty: fStickForce is that of a spring, which says nothing of the momentum. The
! routine therefore makes the stick form from masses, which the model gives, and from the motion that it sees:
!   the impedance        Z = 1/(dt (1/m_soft + 1/m_hard))    m per area: density times half the thickness of the zone at the
!                                                            interface, props(1) for the secondary side, props(2) for the main
!   the slip rate        V = |slip|/dt                        of this increment, before this friction acts
!   what drives it       a = (V - V_before)/dt + s_before (1/m_soft + 1/m_hard)      of the increment before: the forces
!                                                            of the bodies, which the routine does not get
!   the stick stress     T = Z (V + dt a)
! So T lags by one increment: where the friction slides its stress does not depend on T, and the heat of an increment is
! that of a slip which is off by the change of a. In the first increment of a contact a = 0.
!
! The model declares eight state variables (*DEPVAR, nStates = 8) and two properties, and runs in double precision; lengths
! are m, times s, forces N. The scene is the file NAME.toml in the working directory, NAME that of the surface interaction,
! which also names the session: give each pair of materials an interaction of its own, with the soft side as the secondary
! one. SHEARBUS_ENDPOINT names a server; without it one runs in this process. Each process has its own sessions; a node that
! changes the process loses its layer. Restarts: abaqus_layers.f90. A node that touches several surfaces has a layer for
! each. Contact of edges has no layer here: the routine refuses it.
subroutine vfriction(fTangential, state, nBlock, nBlockAnal, nBlockEdge, nNodState, nNodSec, nNodMain, nFricDir, nDir, nStates, &
                     nProps, nTemp, nFields, jFlags, rData, surfInt, surfSec, surfMain, jConSecUid, jConMainUid, props, &
                     dSlipFric, fStickForce, fTangPrev, fNormal, areaCont, dircosN, dircosSl, shapeSec, shapeMain, coordSec, &
                     coordMain, velSec, velMain, tempSec, tempMain, fieldSec, fieldMain)
  use, intrinsic :: iso_fortran_env, only: int64, real64
  use abaqus_layers
  implicit none
  integer, intent(in) :: nBlock, nBlockAnal, nBlockEdge, nNodState, nNodSec, nNodMain, nFricDir, nDir, nStates, nProps, nTemp
  integer, intent(in) :: nFields, jFlags(3), jConSecUid(nNodSec, nBlock), jConMainUid(nNodMain, nBlockAnal)
  real(real64), intent(out) :: fTangential(nFricDir, nBlock)
  real(real64), intent(inout) :: state(nStates, nNodState, nBlock)
  real(real64), intent(in) :: rData(4), props(nProps), dSlipFric(nDir, nBlock), fStickForce(nBlock), fTangPrev(nDir, nBlock)
  real(real64), intent(in) :: fNormal(nBlock), areaCont(nBlock), dircosN(nDir, nBlock), dircosSl(nDir, nBlock)
  real(real64), intent(in) :: shapeSec(nNodSec, nBlockEdge), shapeMain(nNodMain, nBlockAnal), coordSec(nDir, nNodSec, nBlock)
  real(real64), intent(in) :: coordMain(nDir, nNodMain, nBlockAnal), velSec(nDir, nNodSec, nBlock)
  real(real64), intent(in) :: velMain(nDir, nNodMain, nBlockAnal), tempSec(nBlock), tempMain(nBlockAnal)
  real(real64), intent(in) :: fieldSec(nFields, nBlock), fieldMain(nFields, nBlockAnal)
  character(len=80), intent(in) :: surfInt, surfSec, surfMain
  integer, parameter :: v_before = 1, s_before = 4, counted = 7, dt_before = 8  ! places of the state variables
  type(contact_layers), pointer :: layers
  integer(int64) :: ids(nBlock)
  integer :: row(nBlock), k, increment
  logical, allocatable :: named(:)
  real(real64) :: dt, compliance, slip_rate, drive, v, s

  fTangential = 0
  dt = rData(3)
  if (dt <= 0 .or. nBlock == 0) return
  if (nNodSec /= 1) error stop 'vfriction: a contact of edges has no layer: exclude edges from this interaction'
  if (nStates < 8 .or. nProps < 2) error stop 'vfriction: expected 8 state variables and 2 properties, the masses per area'
  compliance = 1/props(1) + 1/props(2)
  increment = jFlags(2)
  ids = jConSecUid(1, :)
  do k = 2, nBlock  ! a node that touches another surface, too: a layer of its own, of a node that no mesh has
    ids(k) = ids(k) + count(jConSecUid(1, :k - 1) == jConSecUid(1, k))*2_int64**40
  end do
  layers => layers_of(surfInt, trim(surfInt)//'.toml', ids, .false., any(state(counted, 1, :) > 0), rData(2) - dt)
  associate (bus => layers%bus)
    if (abs(layers%time - rData(2)) > 0) call end_increment(layers)  ! the first block of another increment
    layers%time = rData(2)
    layers%dt = dt
    call find_rows()
    allocate (named(bus%n), source=.false.)
    do k = 1, nBlock
      if (areaCont(k) <= 0) cycle
      named(row(k)) = .true.
      slip_rate = norm2(dSlipFric(:, k))/dt
      drive = 0
      if (state(counted, 1, k) > 0 .and. nint(state(counted, 1, k)) == increment - 1) then
        v = dot_product(state(v_before:v_before + nDir - 1, 1, k), dircosSl(:, k))
        s = dot_product(state(s_before:s_before + nDir - 1, 1, k), dircosSl(:, k))
        drive = (slip_rate - v)/state(dt_before, 1, k) + s*compliance
      end if
      bus%jump(row(k)) = slip_rate
      bus%pressure(row(k)) = fNormal(k)/areaCont(k)
      bus%impedance(row(k)) = 1/(dt*compliance)
      bus%stick_stress(row(k)) = bus%impedance(row(k))*(slip_rate + dt*drive)
    end do
    layers%touched = layers%touched .or. named
    call bus%step(dt, rData(2), increment, mask=named)  ! a fault prints its text and stops the program
    do k = 1, nBlock
      if (areaCont(k) <= 0) cycle
      fTangential(1, k) = max(-fStickForce(k), min(0.0_real64, -bus%stress(row(k))*areaCont(k)))
      state(v_before:v_before + nDir - 1, 1, k) = bus%jump(row(k))*dircosSl(:, k)
      state(s_before:s_before + nDir - 1, 1, k) = -fTangential(1, k)/areaCont(k)*dircosSl(:, k)
      state(counted, 1, k) = increment
      state(dt_before, 1, k) = dt
    end do
  end associate

contains

  ! The rows of the block's nodes; new nodes are registered.
  subroutine find_rows()
    integer(int64), allocatable :: new(:)
    integer :: i
    associate (bus => layers%bus)
      row = 0
      do i = 1, nBlock
        row(i) = findloc(bus%nodes, ids(i), dim=1)
      end do
      new = pack(ids, row == 0)
      if (size(new) > 0) then
        call bus%register(new)
        layers%touched = [layers%touched, [(.false., i=1, size(new))]]
        do i = 1, nBlock
          if (row(i) == 0) row(i) = findloc(bus%nodes, ids(i), dim=1)
        end do
      end if
      if (.not. allocated(bus%impedance)) allocate (bus%impedance(bus%n), bus%stick_stress(bus%n), source=1.0_real64)
    end associate
  end subroutine
end subroutine
