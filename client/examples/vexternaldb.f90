! Where Abaqus/Explicit writes restart files and ends: the marks and the end of the sessions of vfric.f90 and vfriction.f90.
!
! Documented by the vendor (user subroutine VEXTERNALDB) and not run here: its arguments, the numbers below, and that it is
! called after the other routines of an increment. Run here: this file, by callers of our own.
subroutine vexternaldb(lOp, i_Array, niArray, r_Array, nrArray)
  use, intrinsic :: iso_fortran_env, only: real64
  use vendor_layers
  implicit none
  integer, intent(in) :: lOp, niArray, nrArray
  integer, intent(inout) :: i_Array(niArray)
  real(real64), intent(inout) :: r_Array(nrArray)
  integer, parameter :: writes_restart = 6, total_time = 1                  ! places in the arrays
  integer, parameter :: end_of_increment = 4, end_of_analysis = 6           ! values of lOp
  if (lOp == end_of_increment .and. i_Array(writes_restart) == 1) call keep_layers(r_Array(total_time))
  if (lOp == end_of_analysis) call end_layers()
end subroutine
