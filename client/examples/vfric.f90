! Template of a user friction routine that asks shearbus: VFRIC of Abaqus/Explicit, for kinematic contact pairs.
!
! Documented by the vendor (user subroutine VFRIC) and not run here: the list of arguments, that the routine gets all
! contact points of a pair at once, local direction 1 along the predicted slip of the increment, fStickForce the
! magnitude of the force that makes this slip zero, fTangential(1,:) between -fStickForce and 0. Run here: this file, by
! a caller of our own (tests/contract/vfric_caller.f90) that solves two half-spaces with an exact answer.
!
! What the service needs, from what the routine gets (dt = dTimCur, A = areaSec, slip = dSlipFric(1,:) of the point):
!   the slip rate without friction   V_free = slip/dt              since kinematic contact predicts without friction
!   the stick stress                 T = fStickForce/A             the traction that makes the new slip rate zero
!   the impedance                    Z = T/V_free                  since the new rate is V_free - s/Z, and 0 for s = T
!   the slip rate before             V_old = V_new of the last increment     since that is what was answered
! State variables 1 to 3 hold V_new as a vector, since direction 1 turns with the slip. A point that did not touch in
! the last increment has no V_old: V_free stands for it. The mechanics of the increment depends on V_free alone, the
! heat on (V_old + V_new)/2. V_old is the answer itself, so the closure check has nothing to compare and is off. In
! penalty contact the stick force is that of a spring and gives no impedance: do not use this routine there. The
! friction is that of one component along the slip.
!
! The model declares four state variables (*DEPVAR in the surface interaction, nStateVar = 4) and runs in double
! precision; lengths are m, times s, forces N. The scene is the file NAME.toml in the working directory, NAME that of
! the surface interaction; SHEARBUS_ENDPOINT names a server, without it one runs in this process. Each surface pair has
! a session of its own with all nodes of its secondary surface, below. Where a run has several processes, each opens
! sessions for the pairs it calls this routine for; a node that changes the process loses its layer here. A host whose
! nodes do that moves them by shearbus_mpi_redistribute, between increments. Restarts, and the end of the run:
! vendor_layers.f90, which is compiled before this file, and vexternaldb.f90. General contact calls vfriction.f90.
subroutine vfric(fTangential, statev, kStep, kInc, nContact, nFacNod, nSecNod, nMainNod, nFricDir, nDir, nStateVar, nProps, &
                 nTemp, nPred, numDefTfv, jSecUid, jMainUid, jConSecid, jConMainid, timStep, timGlb, dTimCur, surfInt, surfSec, &
                 surfMain, lContType, dSlipFric, fStickForce, fTangPrev, fNormal, frictionWork, shape, coordSec, coordMain, &
                 dirCosSl, dircosN, props, areaSec, tempSec, preDefSec, tempMain, preDefMain)
  use, intrinsic :: iso_fortran_env, only: int64, real64
  use vendor_layers
  implicit none
  integer, intent(in) :: kStep, kInc, nContact, nFacNod, nSecNod, nMainNod, nFricDir, nDir, nStateVar, nProps, nTemp, nPred
  integer, intent(in) :: numDefTfv, jSecUid(nSecNod), jMainUid(nMainNod), jConSecid(nContact), jConMainid(nFacNod, nContact)
  integer, intent(in) :: lContType
  real(real64), intent(out) :: fTangential(nFricDir, nContact)
  real(real64), intent(inout) :: statev(nStateVar, nSecNod)
  real(real64), intent(in) :: timStep, timGlb, dTimCur, dSlipFric(nDir, nContact), fStickForce(nContact)
  real(real64), intent(in) :: fTangPrev(nDir, nContact), fNormal(nContact), frictionWork, shape(nFacNod, nContact)
  real(real64), intent(in) :: coordSec(nDir, nSecNod), coordMain(nDir, nMainNod), dirCosSl(nDir, nContact)
  real(real64), intent(in) :: dircosN(nDir, nContact), props(nProps), areaSec(nSecNod), tempSec(nContact)
  real(real64), intent(in) :: preDefSec(nContact, nPred), tempMain(numDefTfv), preDefMain(numDefTfv, nPred)
  character(len=80), intent(in) :: surfInt, surfSec, surfMain
  type(contact_layers), pointer :: layers
  logical :: touches(nSecNod)
  real(real64) :: v_free
  integer :: k, n

  fTangential = 0
  if (dTimCur <= 0) return
  if (nStateVar < 4) error stop 'vfric: expected 4 state variables'
  layers => layers_of(trim(surfInt)//'.'//trim(surfSec)//'.'//trim(surfMain), trim(surfInt)//'.toml', int(jSecUid, int64), &
                      .true., any(abs(statev(4, :)) > 0), timGlb - dTimCur)
  associate (bus => layers%bus)
    if (.not. allocated(bus%impedance)) then
      allocate (bus%impedance(nSecNod), bus%stick_stress(nSecNod), source=1.0_real64)
      bus%jump = 0*bus%impedance
      bus%pressure = 0*bus%impedance
      where (statev(4, :) <= 0) statev(4, :) = -10  ! no increment has this number or the one before it
    end if

    touches = .false.
    do k = 1, nContact
      n = jConSecid(k)  ! the surface node: the row of the session
      if (areaSec(n) <= 0) cycle
      touches(n) = .true.
      v_free = dSlipFric(1, k)/dTimCur
      bus%pressure(n) = fNormal(k)/areaSec(n)
      bus%stick_stress(n) = fStickForce(k)/areaSec(n)
      bus%impedance(n) = 1  ! any: without slip nothing depends on it
      if (v_free > 0 .and. fStickForce(k) > 0) bus%impedance(n) = bus%stick_stress(n)/v_free
      bus%jump(n) = v_free
      if (nint(statev(4, n)) == kInc - 1) bus%jump(n) = dot_product(statev(1:nDir, n), dirCosSl(:, k))
    end do
    call bus%step(dTimCur, timGlb, kInc, mask=touches, open_absent=.true.)  ! a fault prints its text and stops the program
    do k = 1, nContact
      n = jConSecid(k)
      if (.not. touches(n)) cycle
      fTangential(1, k) = max(-fStickForce(k), min(0.0_real64, -bus%stress(n)*areaSec(n)))
      statev(1:nDir, n) = bus%jump_new(n)*dirCosSl(:, k)
      statev(4, n) = kInc
    end do
  end associate
end subroutine
