! A caller of the friction routine of client/examples/usrfrc.f90, in place of the commercial code that it is written for: the
! problem, and the arguments, of penalty_host.f90. A spring's force is limited by the coefficient times the normal force.
program usrfrc_caller
  use, intrinsic :: iso_fortran_env, only: real64
  use friction_host, only: fault, half_mass
  use penalty_host
  use vendor_layers, only: end_layers, keep_layers
  implicit none
  call run_penalty_host(ask, told)

contains

  subroutine ask(points)
    type(block_of_points), intent(inout) :: points
    interface
      subroutine shearbus_usrfrc(contact, cycle, time, dt, nodes, areas, normal_force, slip, normals, masses, states, mu)
        import
        integer, intent(in) :: contact, cycle, nodes(:)
        real(real64), intent(in) :: time, dt, areas(:), normal_force(:), slip(:, :), normals(:, :), masses(2)
        real(real64), intent(inout) :: states(:, :)
        real(real64), intent(out) :: mu(:)
      end subroutine
    end interface
    real(real64) :: mu(size(points%ids)), slip(3, size(points%ids))
    slip = points%slip + 7*points%normal  ! the nodes move along the normal, too
    call shearbus_usrfrc(points%pair, points%step, points%time, points%dt, points%ids, points%areas, points%normal_force, slip, &
                         points%normal, half_mass, points%states, mu)
    if (any(mu < 0 .or. mu > 10)) call fault('a coefficient out of its range', points%step, points%pair, 1)
    points%friction = min(points%stick_force, mu*points%normal_force)/points%areas
  end subroutine

  subroutine told(lOp, step, time, step_dt)
    integer, intent(in) :: lOp, step
    real(real64), intent(in) :: time, step_dt
    if (step < 1 .or. step_dt <= 0) call fault('a cycle without a length', step, 0, 0)
    if (lOp == 4) call keep_layers(time)
    if (lOp == 6) call end_layers()
  end subroutine
end program
