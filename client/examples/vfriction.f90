! Template of a user friction routine that asks shearbus: VFRICTION of Abaqus/Explicit, for general contact.
!
! Documented by the vendor (user subroutine VFRICTION) and not run here: the list of arguments; that the routine gets the
! contact points of an interaction in blocks, several calls an increment, without names of surfaces; local direction 1
! along the slip of the increment; fStickForce the force that prevents further slip; fTangential(1,:) between -fStickForce
! and 0. Run here: this file, by a caller of our own (tests/contract/vfriction_caller.f90) that solves two half-spaces with
! an exact answer, and restarts.
!
! General contact enforces sticking by a penalty: step_of_block in vendor_layers.f90 makes the stick form from the motion,
! and from masses per area that the model gives: density times half the thickness of the zone at the interface, props(1) for
! the secondary side, props(2) for the main one.
!
! The model declares eight state variables (*DEPVAR, nStates = 8) and two properties, and runs in double precision; lengths
! are m, times s, forces N. The scene is the file NAME.toml in the working directory, NAME that of the surface interaction,
! which also names the session: give each pair of materials an interaction of its own, with the soft side as the secondary
! one. SHEARBUS_ENDPOINT names a server; without it one runs in this process. Each process has its own sessions; a node that
! changes the process loses its layer. Restarts: vendor_layers.f90 and vexternaldb.f90. A node that touches several surfaces
! has a layer for each. Contact of edges has no layer here: the routine refuses it.
subroutine vfriction(fTangential, state, nBlock, nBlockAnal, nBlockEdge, nNodState, nNodSec, nNodMain, nFricDir, nDir, nStates, &
                     nProps, nTemp, nFields, jFlags, rData, surfInt, surfSec, surfMain, jConSecUid, jConMainUid, props, &
                     dSlipFric, fStickForce, fTangPrev, fNormal, areaCont, dircosN, dircosSl, shapeSec, shapeMain, coordSec, &
                     coordMain, velSec, velMain, tempSec, tempMain, fieldSec, fieldMain)
  use, intrinsic :: iso_fortran_env, only: real64
  use vendor_layers
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
  real(real64) :: stress(nBlock), states(states_of_block, nBlock)
  integer :: k

  fTangential = 0
  if (rData(3) <= 0 .or. nBlock == 0) return
  if (nNodSec /= 1) error stop 'vfriction: a contact of edges has no layer: exclude edges from this interaction'
  if (nStates < states_of_block .or. nProps < 2) &
    error stop 'vfriction: expected 8 state variables and 2 properties, the masses per area'
  states = state(:states_of_block, 1, :)
  call step_of_block(trim(surfInt), jConSecUid(1, :), areaCont, fNormal, norm2(dSlipFric, dim=1)/rData(3), dircosSl, props(:2), &
                     rData(2), rData(3), jFlags(2), states, stress)
  do k = 1, nBlock
    if (areaCont(k) <= 0) cycle
    fTangential(1, k) = max(-fStickForce(k), min(0.0_real64, -stress(k)*areaCont(k)))
    states(s_before:s_before + nDir - 1, k) = -fTangential(1, k)/areaCont(k)*dircosSl(:, k)
  end do
  state(:states_of_block, 1, :) = states
end subroutine
