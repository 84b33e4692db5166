! The example host of host.c in Fortran: two elastic half-spaces slide on each other at ten interface nodes, with another
! pressure at each, and the velocity jump has an exact value.
!
!   host SCENE.toml [ENDPOINT]      without an endpoint the server runs in this process
program host
  use, intrinsic :: iso_fortran_env, only: real64
  use shearbus
  implicit none
  integer, parameter :: nodes = 10, zones = 80, steps = 60, soft = 1, hard = 2
  real(real64), parameter :: dt = 1e-9_real64, jump = 100, friction = 0.1_real64
  real(real64), parameter :: density(2) = [2703.0_real64, 7900.0_real64], modulus(2) = [27.6e9_real64, 77e9_real64]
  real(real64), parameter :: impedance(2) = sqrt(density*modulus)
  real(real64), parameter :: zone(2) = dt*impedance/density        ! a shear wave crosses a zone in dt
  real(real64), parameter :: half_mass(2) = 0.5_real64*density*zone
  real(real64), parameter :: side(2) = [1.0_real64, -1.0_real64]   ! soft at z > 0, hard at z < 0
  ! Velocities at grid points and half steps, stresses in zones and at full steps; the interface is at 0.
  real(real64) :: v(0:zones, nodes, 2), s(0:zones - 1, nodes, 2), step_dt, time, exact(nodes), found(nodes)
  type(shearbus_interface) :: bus
  character(len=500) :: scene, endpoint
  integer :: b, n, t

  scene = 'constant_friction.toml'
  endpoint = ''
  if (command_argument_count() > 0) call get_command_argument(1, scene)
  if (command_argument_count() > 1) call get_command_argument(2, endpoint)
  call bus%open(scene=scene, endpoint=endpoint, nodes=[(n, n=1, nodes)])

  v(:, :, soft) = jump
  v(:, :, hard) = 0
  s = 0
  time = 0
  bus%pressure = [(1e8_real64*n, n=1, nodes)]
  bus%mass_soft = half_mass(soft)
  bus%mass_hard = half_mass(hard)
  do t = 1, steps
    step_dt = merge(0.5_real64*dt, dt, t == 1)   ! the first velocities are half a step after the start
    time = time + step_dt
    bus%jump = v(0, :, soft) - v(0, :, hard)
    bus%stress_soft = s(0, :, soft)
    bus%stress_hard = s(0, :, hard)
    call bus%step(step_dt, time, t)
    do b = soft, hard
      v(0, :, b) = v(0, :, b) + side(b)*step_dt/half_mass(b)*(s(0, :, b) - bus%stress)
      v(1:zones - 1, :, b) = v(1:zones - 1, :, b) + side(b)*step_dt/(density(b)*zone(b))*(s(1:, :, b) - s(:zones - 2, :, b))
      s(:, :, b) = s(:, :, b) + side(b)*dt*modulus(b)/zone(b)*(v(1:, :, b) - v(:zones - 1, :, b))
    end do
  end do

  found = v(0, :, soft) - v(0, :, hard)
  exact = jump - friction*bus%pressure*(1/impedance(soft) + 1/impedance(hard))
  do n = 1, nodes
    print '(a,i3,a,f6.0,a,f10.6,a,f10.6,a,f7.2,a)', 'node', n, '  P', bus%pressure(n)/1e6_real64, ' MPa  [V]', found(n), &
      ' m/s  exact', exact(n), '  T0', bus%temperature(n), ' K'
  end do
  call bus%close()
  if (maxval(abs(found - exact)) > 1e-6_real64) error stop 1
end program
