! The example host of host.f90 on MPI ranks. Nodes move between the ranks in mid-run, as where a mesh is balanced anew,
! and the answers are those of one rank, to the bit. With `root` as the third argument rank 0 alone has a session, with
! the nodes of all ranks, and no node moves.
!
!   mpirun -n RANKS host_mpi SCENE.toml ENDPOINT [root]
program host_mpi
  use, intrinsic :: iso_fortran_env, only: int64, real64
  use mpi
  use shearbus
  implicit none
  integer, parameter :: nodes = 10, zones = 80, steps = 60, soft = 1, hard = 2
  real(real64), parameter :: dt = 1e-9_real64, jump = 100, friction = 0.1_real64
  real(real64), parameter :: density(2) = [2703.0_real64, 7900.0_real64], modulus(2) = [27.6e9_real64, 77e9_real64]
  real(real64), parameter :: impedance(2) = sqrt(density*modulus)
  real(real64), parameter :: zone(2) = dt*impedance/density        ! a shear wave crosses a zone in dt
  real(real64), parameter :: half_mass(2) = 0.5_real64*density*zone
  real(real64), parameter :: side(2) = [1.0_real64, -1.0_real64]   ! soft at z > 0, hard at z < 0
  ! Velocities at grid points and half steps, stresses in zones and at full steps; the interface is at 0. Each rank has
  ! room for all nodes and steps its own.
  real(real64) :: v(0:zones, 2, nodes), s(0:zones - 1, 2, nodes), answers(2, nodes), step_dt, time, exact, worst
  type(shearbus_ranks) :: ranks
  type(shearbus_interface) :: bus
  character(len=500) :: scene, endpoint, root, msg
  integer :: owner(nodes), new_owner(nodes), rank, n_ranks, b, i, n, t, stat, fault
  logical :: on_root

  call MPI_Init(fault)
  call MPI_Comm_rank(MPI_COMM_WORLD, rank, fault)
  call MPI_Comm_size(MPI_COMM_WORLD, n_ranks, fault)
  call get_command_argument(1, scene)
  call get_command_argument(2, endpoint)
  call get_command_argument(3, root)
  on_root = root == 'root'
  owner = [(mod(n, n_ranks), n=1, nodes)]
  call shearbus_mpi_open(ranks, MPI_COMM_WORLD, bus, scene=scene, endpoint=endpoint, on_root=on_root, &
                         nodes=pack([(int(n, int64), n=1, nodes)], owner == rank))

  v(:, soft, :) = jump
  v(:, hard, :) = 0
  s = 0
  time = 0
  do t = 1, steps
    step_dt = merge(0.5_real64*dt, dt, t == 1)   ! the first velocities are half a step after the start
    time = time + step_dt
    bus%pressure = 1e8_real64*real(bus%nodes, real64)
    bus%mass_soft = [(half_mass(soft), i=1, bus%n)]
    bus%mass_hard = [(half_mass(hard), i=1, bus%n)]
    bus%jump = v(0, soft, bus%nodes) - v(0, hard, bus%nodes)
    bus%stress_soft = s(0, soft, bus%nodes)
    bus%stress_hard = s(0, hard, bus%nodes)
    call bus%step(step_dt, time, t, stat=stat, msg=msg)
    call shearbus_mpi_agree(ranks, stat, msg)      ! if one rank is refused, all stop
    if (stat /= 0) then
      print '(a)', trim(msg)
      error stop 1
    end if
    do i = 1, bus%n
      n = int(bus%nodes(i))
      do b = soft, hard
        v(0, b, n) = v(0, b, n) + side(b)*step_dt/half_mass(b)*(s(0, b, n) - bus%stress(i))
        v(1:zones - 1, b, n) = v(1:zones - 1, b, n) + side(b)*step_dt/(density(b)*zone(b))*(s(1:, b, n) - s(:zones - 2, b, n))
        s(:, b, n) = s(:, b, n) + side(b)*dt*modulus(b)/zone(b)*(v(1:, b, n) - v(:zones - 1, b, n))
      end do
    end do
    if (mod(t, 10) == 5 .and. .not. on_root) then
      new_owner = [(mod(n + t/10, n_ranks), n=1, nodes)]
      call shearbus_mpi_redistribute(ranks, bus, new_owner(bus%nodes))
      do n = 1, nodes                              ! the host's own data of a node that has moved
        if (new_owner(n) == owner(n)) cycle
        call MPI_Bcast(v(:, :, n), size(v(:, :, n)), MPI_DOUBLE_PRECISION, owner(n), MPI_COMM_WORLD, fault)
        call MPI_Bcast(s(:, :, n), size(s(:, :, n)), MPI_DOUBLE_PRECISION, owner(n), MPI_COMM_WORLD, fault)
      end do
      owner = new_owner
    end if
  end do

  answers = 0
  do i = 1, bus%n
    answers(:, bus%nodes(i)) = [v(0, soft, bus%nodes(i)) - v(0, hard, bus%nodes(i)), bus%temperature(i)]
  end do
  call MPI_Allreduce(MPI_IN_PLACE, answers, size(answers), MPI_DOUBLE_PRECISION, MPI_SUM, MPI_COMM_WORLD, fault)
  call shearbus_mpi_close(ranks, bus)
  worst = 0
  do n = 1, nodes
    exact = jump - friction*1e8_real64*n*(1/impedance(soft) + 1/impedance(hard))
    worst = max(worst, abs(answers(1, n) - exact))
    if (rank == 0) print '(a,i3,a,f6.0,a,f10.6,a,f10.6,a,f20.15,a)', 'node', n, '  P', 100.0_real64*n, ' MPa  [V]', &
      answers(1, n), ' m/s  exact', exact, '  T0', answers(2, n), ' K'
  end do
  call MPI_Finalize(fault)
  if (worst > 1e-6_real64) error stop 1
end program
