! What the callers of the friction routines share: two elastic half-spaces at ten nodes, in central differences with steps of
! one transit time of a zone, for which they are exact, the sessions in far-field form that their answers are compared with,
! and the calls at the end of an increment or of the run.
module friction_host
  use, intrinsic :: iso_fortran_env, only: error_unit, real64
  use shearbus, only: shearbus_interface
  implicit none
  integer, parameter :: nodes = 10, zones = 80, steps = 60, leaves = 41, returns = 51, lifted = 8, soft = 1, hard = 2, pairs = 2
  integer, parameter :: dumped = 46  ! step after which the host writes its restart file
  real(real64), parameter :: dt = 1e-9_real64, jump = 100, friction = 0.1_real64, area = 2.5e-7_real64
  real(real64), parameter :: density(2) = [2703.0_real64, 7900.0_real64], modulus(2) = [27.6e9_real64, 77e9_real64]
  real(real64), parameter :: impedance(2) = sqrt(density*modulus)
  real(real64), parameter :: zone(2) = dt*impedance/density, half_mass(2) = 0.5_real64*density*zone
  integer :: faults = 0

contains

  subroutine fault(what, step, pair, row)
    character(len=*), intent(in) :: what
    integer, intent(in) :: step, pair, row
    faults = faults + 1
    write (error_unit, '(2a,3i5)') what, ' at step, pair, row', step, pair, row
  end subroutine

  ! Opens the session of the nodes of a pair in far-field form.
  subroutine open_far_field(bus, scene, ids)
    type(shearbus_interface), intent(inout) :: bus
    character(len=*), intent(in) :: scene
    integer, intent(in) :: ids(nodes)
    call bus%open(scene=scene, nodes=ids, check_closure='off')
    bus%mass_soft = spread(half_mass(soft), 1, nodes)
    bus%mass_hard = spread(half_mass(hard), 1, nodes)
  end subroutine

  ! The jump of a node at the end, against its exact value where `exactly`, and what is printed of it.
  subroutine check_jump(found, pair, row, exactly)
    real(real64), intent(in) :: found
    integer, intent(in) :: pair, row
    logical, intent(in) :: exactly
    real(real64) :: exact
    exact = exact_jump(1e8_real64*row/pair)
    if (exactly .and. abs(found - exact) > 1e-6_real64) call fault('another jump', steps, pair, row)
    if (pair == 1 .and. row == 5) print '(a,f10.6,a,f10.6)', 'node 5: [V]', found, ' m/s, with constant friction', exact
    if (pair == 1 .and. row == lifted) print '(a,es24.16)', 'node 8: [V]', found
  end subroutine

  ! Moves the bodies under a stress of friction at each node.
  subroutine move(v, s, stress, step_dt)
    real(real64), intent(inout) :: v(0:zones, nodes, 2), s(0:zones - 1, nodes, 2)
    real(real64), intent(in) :: stress(nodes), step_dt
    real(real64), parameter :: side(2) = [1.0_real64, -1.0_real64]
    integer :: b
    do b = soft, hard
      v(0, :, b) = v(0, :, b) + side(b)*step_dt/half_mass(b)*(s(0, :, b) - stress)
      v(1:zones - 1, :, b) = v(1:zones - 1, :, b) + side(b)*step_dt/(density(b)*zone(b))*(s(1:, :, b) - s(:zones - 2, :, b))
      s(:, :, b) = s(:, :, b) + side(b)*dt*modulus(b)/zone(b)*(v(1:, :, b) - v(:zones - 1, :, b))
    end do
  end subroutine

  ! The jump of a node under constant friction.
  function exact_jump(pressure) result(exact)
    real(real64), intent(in) :: pressure
    real(real64) :: exact
    exact = jump - friction*pressure*(1/impedance(soft) + 1/impedance(hard))
  end function

  ! Tells the routines of the end of an increment (lOp = 4), at which the host writes restart files, or of the run (6).
  subroutine end_of(lOp, step, time, step_dt)
    integer, intent(in) :: lOp, step
    real(real64), intent(in) :: time, step_dt
    integer :: i_Array(6)
    real(real64) :: r_Array(3)
    interface
      subroutine vexternaldb(lOp, i_Array, niArray, r_Array, nrArray)
        import
        integer, intent(in) :: lOp, niArray, nrArray
        integer, intent(inout) :: i_Array(niArray)
        real(real64), intent(inout) :: r_Array(nrArray)
      end subroutine
    end interface
    i_Array = [0, 0, 1, step, 0, merge(1, 0, lOp == 4)]
    r_Array = [time, time, step_dt]
    call vexternaldb(lOp, i_Array, size(i_Array), r_Array, size(r_Array))
  end subroutine
end module
