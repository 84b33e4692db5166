! A Fortran host whose own law answers while the server is gone: fortran_fallback SCENE.toml ENDPOINT PID_FILE. The server is
! durable and is started again when this program has killed it; SHEARBUS_FALLBACK allows the law.
module own_law_of_host
  use, intrinsic :: iso_fortran_env, only: real64
  use shearbus
  implicit none
contains
  subroutine law(bus)
    class(shearbus_interface), intent(inout) :: bus
    bus%stress = 0.2_real64*bus%pressure
  end subroutine
end module

program fortran_fallback
  use, intrinsic :: iso_fortran_env, only: error_unit, int64, real64
  use shearbus
  use own_law_of_host
  implicit none
  integer, parameter :: nodes = 4
  type(shearbus_interface) :: bus
  character(len=500) :: scene, endpoint, pid_file
  integer :: i, alone, faults
  integer(int64) :: begun, now, rate
  logical :: touches(nodes)
  real(real64) :: hot(nodes)

  call get_command_argument(1, scene)
  call get_command_argument(2, endpoint)
  call get_command_argument(3, pid_file)
  faults = 0
  call bus%open(scene=scene, endpoint=endpoint, nodes=[(i, i=1, nodes)], check_closure='off')
  call bus%set_fallback(law)
  bus%jump = 100
  bus%pressure = [(1e8_real64*i, i=1, nodes)]
  bus%stress_soft = 0
  bus%stress_hard = 0
  bus%mass_soft = 4e-3_real64
  bus%mass_hard = 12e-3_real64
  touches = [(i /= 2, i=1, nodes)]
  do i = 1, 3
    call bus%step(1e-9_real64)
    if (any(bus%outcome /= 0)) call fault('a server that answers')
  end do
  hot = bus%temperature
  call execute_command_line('kill -9 $(cat '//trim(pid_file)//')')
  alone = 0
  call system_clock(begun, rate)
  do
    call bus%step(1e-9_real64, mask=touches)
    call system_clock(now)
    if (bus%outcome(1) == shearbus_outcome_fallback) then
      alone = alone + 1
      if (any(abs(bus%stress - merge(0.2_real64, 0.1_real64, touches)*bus%pressure) > merge(0, 1, touches))) &
        call fault('the stress of the own law, and of the server in the row not stepped')
      if (any(abs(bus%temperature - hot) > 0)) call fault('the temperature, which the own law leaves as it was')
      if (bus%flagged /= 3 .or. bus%outcome(2) /= 0) call fault('rows of the own law')
    end if
    if (alone > 0 .and. bus%outcome(1) == 0) exit
    if (now - begun > 30*rate) exit
  end do
  if (alone == 0 .or. bus%outcome(1) /= 0) call fault('the own law, and then the server')
  if (any(abs(bus%stress(3:) - 0.1_real64*bus%pressure(3:)) > 1)) call fault('the stress of the server')
  call bus%close()
  if (faults > 0) error stop 1

contains
  subroutine fault(what)
    character(len=*), intent(in) :: what
    faults = faults + 1
    write (error_unit, '(2a,2i6,4es12.4,4i5)') 'not so: ', what, alone, bus%flagged, bus%stress, bus%outcome
  end subroutine
end program
