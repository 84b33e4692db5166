! A caller of the user friction routine of client/examples/vfriction.f90, in place of the commercial code that it is written
! for: the problem, and the arguments, of penalty_host.f90.
program vfriction_caller
  use, intrinsic :: iso_fortran_env, only: real64
  use friction_host, only: end_of, fault, half_mass
  use penalty_host
  implicit none
  call run_penalty_host(ask, end_of)

contains

  subroutine ask(points)
    type(block_of_points), intent(inout) :: points
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
    character(len=80), parameter :: interactions(2) = [character(len=80) :: 'TOP', 'SIDE'], blank = ''
    integer :: m, i, main(4, size(points%ids))
    real(real64) :: force(2, size(points%ids)), states(8, 1, size(points%ids)), none(3, 4, size(points%ids))
    m = size(points%ids)
    none = 0
    main = 0
    states(:, 1, :) = points%states
    call vfriction(force, states, m, m, 1, 1, 1, 4, 2, 3, 8, 2, 1, 1, [1, points%step, 1], &
                   [points%time, points%time, points%dt, 0.0_real64], interactions(points%pair), blank, blank, &
                   reshape(points%ids, [1, m]), main, half_mass, points%slip*points%dt, points%stick_force, none(:, 1, :), &
                   points%normal_force, points%areas, none(:, 1, :), points%along, none(:1, :1, 1), none(1, :, :), &
                   none(:, :1, :), none, none(:, :1, :), none, points%normal_force, points%normal_force, none(:1, 1, :), &
                   none(:1, 1, :))
    do i = 1, m
      if (force(1, i) < -points%stick_force(i) .or. force(1, i) > 0 .or. abs(force(2, i)) > 0) &
        call fault('a force out of its range', points%step, points%pair, i)
    end do
    points%friction = -force(1, :)/points%areas
    points%states = states(:, 1, :)
  end subroutine
end program
