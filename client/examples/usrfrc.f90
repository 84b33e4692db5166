! Template of a user friction routine that asks shearbus: usrfrc of LS-DYNA.
!
! Documented in public and not run here: that *CONTROL_CONTACT (USRFRC) and *USER_INTERFACE_FRICTION switch the routine on,
! the latter with numbers of the model and history variables of each interface node; that a contact is a penalty, whose
! tangential spring is limited by the coefficient of friction times the normal force; that the routine gives this
! coefficient. The routine itself and the list of its arguments come with the vendor's object version under a licence and are
! not here: call this subroutine from it, for the active nodes of a call, with what the list has. Run here: this file, by a
! caller of our own (tests/contract/usrfrc_caller.f90) that solves two half-spaces with an exact answer, and restarts.
!
! contact         number of the contact: its scene is CONTACT_<number>.toml in the working directory, its session, and the
!                 ticket for restarts, are CONTACT_<number>
! cycle, time, dt number of the cycle, time at its end and its length
! nodes           the active nodes, on the tracked side: the soft body
! areas           m2, that the nodes stand for
! normal_force    N, positive in compression
! slip            m/s, velocity of the node against that of the segment; a relative displacement over its step
! normals         of the segments, of length 1
! masses          kg/m2, of the tracked side and the other one: density times half the thickness of the zone at the
!                 interface; numbers of the model
! states          eight history variables of each node, zero where its contact begins
! mu              coefficient of friction of each node, for sticking and sliding alike; no decay
!
! Lengths are m, times s, forces N; real numbers of double precision. SHEARBUS_ENDPOINT names a server; without it one runs in
! this process. Each process has its own sessions: a node that changes the process loses its layer. How the stick form is
! made from the motion, and restarts: vendor_layers.f90, which is compiled before this file. Where your solution control
! knows that the host writes restart files, call keep_layers(time); at the end of the run call end_layers().
subroutine shearbus_usrfrc(contact, cycle, time, dt, nodes, areas, normal_force, slip, normals, masses, states, mu)
  use, intrinsic :: iso_fortran_env, only: real64
  use vendor_layers
  implicit none
  integer, intent(in) :: contact, cycle, nodes(:)
  real(real64), intent(in) :: time, dt, areas(:), normal_force(:), slip(:, :), normals(:, :), masses(2)
  real(real64), intent(inout) :: states(:, :)
  real(real64), intent(out) :: mu(:)
  real(real64) :: rate(size(nodes)), along(3, size(nodes)), stress(size(nodes)), direction(3)
  character(len=20) :: key
  integer :: k

  mu = 0
  if (dt <= 0 .or. size(nodes) == 0) return
  if (size(states, 1) < states_of_block) error stop 'usrfrc: expected 8 history variables of each node'
  if (any(masses <= 0)) error stop 'usrfrc: expected the masses per area of both sides, above 0'
  do k = 1, size(nodes)
    direction = slip(:, k) - dot_product(slip(:, k), normals(:, k))*normals(:, k)
    rate(k) = norm2(direction)
    if (rate(k) <= 0) direction = states(s_before:s_before + 2, k)  ! sticks: along the stress
    along(:, k) = direction/max(norm2(direction), tiny(rate))
  end do
  write (key, '(a,i0)') 'CONTACT_', contact
  call step_of_block(trim(key), nodes, areas, normal_force, rate, along, masses, time, dt, cycle, states, stress)
  where (normal_force > 0) mu = max(0.0_real64, stress)*areas/normal_force
end subroutine
