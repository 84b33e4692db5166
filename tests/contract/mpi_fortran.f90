! The MPI helpers of the Fortran module against a live server: mpi_fortran SCENE.toml ENDPOINT DIRECTORY, started by
! mpi.py on several ranks. Every fault is printed; the program stops with an error if there is one.
program mpi_fortran
  use, intrinsic :: iso_fortran_env, only: error_unit, int64, real64
  use mpi
  use shearbus
  implicit none
  integer, parameter :: nodes = 8
  real(real64), parameter :: dt = 1e-9_real64
  character(len=500) :: scene, endpoint, directory, msg
  integer :: rank, ranks_there, fault, faults, of_all, stat, i
  type(shearbus_ranks) :: ranks
  type(shearbus_interface) :: bus
  real(real64) :: expected(nodes)

  call MPI_Init(fault)
  call MPI_Comm_rank(MPI_COMM_WORLD, rank, fault)
  call MPI_Comm_size(MPI_COMM_WORLD, ranks_there, fault)
  call get_command_argument(1, scene)
  call get_command_argument(2, endpoint)
  call get_command_argument(3, directory)
  faults = 0
  call alone()
  call dumps()
  call on_root()
  call MPI_Allreduce(faults, of_all, 1, MPI_INTEGER, MPI_SUM, MPI_COMM_WORLD, fault)
  call MPI_Finalize(fault)
  if (of_all > 0) error stop 1

contains

  subroutine check(what, is_so)
    character(len=*), intent(in) :: what
    logical, intent(in) :: is_so
    if (is_so) return
    faults = faults + 1
    write (error_unit, '(a,i0,2a)') 'rank ', rank, ', not so: ', what
  end subroutine

  subroutine ok(what)
    character(len=*), intent(in) :: what
    if (stat /= 0) write (error_unit, '(a,i0,4a)') 'rank ', rank, ', ', what, ': ', trim(msg)
    if (stat /= 0) call MPI_Abort(MPI_COMM_WORLD, 1, fault)
  end subroutine

  subroutine refused(what, code, word)
    character(len=*), intent(in) :: what, word
    integer, intent(in) :: code
    call check(what//' "'//trim(msg)//'"', stat == code .and. index(msg, 'rank ') > 0 .and. index(msg, word) > 0)
  end subroutine

  ! The nodes of a rank, dealt out from one rank on.
  function mine(first) result(list)
    integer, intent(in) :: first
    integer(int64), allocatable :: list(:)
    list = pack([(int(i, int64), i=1, nodes)], [(mod(i + first, ranks_there) == rank, i=1, nodes)])
  end function

  subroutine fill()
    bus%jump = 90 + real(bus%nodes, real64)
    bus%pressure = 1e8_real64*real(bus%nodes, real64)
    bus%stress_soft = 0*bus%jump
    bus%stress_hard = 0*bus%jump
    bus%mass_soft = 0*bus%jump + 4e-3_real64
    bus%mass_hard = 0*bus%jump + 12e-3_real64
  end subroutine

  ! What two steps of all nodes answer in one session.
  subroutine alone()
    if (rank == 0) then
      call bus%open(nodes=[(i, i=1, nodes)], scene=scene, endpoint=endpoint, check_closure='off')
      call fill()
      call bus%step(dt)
      call bus%step(dt)
      expected = bus%temperature
      call bus%close()
    end if
    call MPI_Bcast(expected, nodes, MPI_DOUBLE_PRECISION, 0, MPI_COMM_WORLD, fault)
  end subroutine

  subroutine dumps()
    real(real64), allocatable :: temperatures(:)
    temperatures = [(300.0_real64, i=1, size(mine(0)) + merge(1, 0, rank == ranks_there - 1))]
    call shearbus_mpi_open(ranks, MPI_COMM_WORLD, bus, mine(0), scene=scene, endpoint=endpoint, &
                           initial_temperature=temperatures, stat=stat, msg=msg)
    call refused('temperatures of one rank', 105, 'initial_temperature has the size')
    call shearbus_mpi_open(ranks, MPI_COMM_WORLD, bus, mine(0), scene=scene, endpoint=endpoint, check_closure='off', &
                           stat=stat, msg=msg)
    call ok('open')
    call fill()
    call bus%step(dt)
    stat = 0
    msg = ''
    if (rank == ranks_there - 1) stat = 306
    if (rank == ranks_there - 1) msg = 'of the host'
    call shearbus_mpi_agree(ranks, stat, msg)
    call refused('agree', 306, 'of the host')
    call shearbus_mpi_redistribute(ranks, bus, [integer ::], stat, msg)
    call refused('no owners', 105, 'new_owner has the size 0')
    call shearbus_mpi_redistribute(ranks, bus, [(ranks_there, i=1, bus%n)], stat, msg)
    call refused('no such rank', 301, 'new_owner of node')
    call shearbus_mpi_dump(ranks, bus, 'mark', trim(directory)//'/fortran.tickets', stat, msg)
    call ok('dump')
    call shearbus_mpi_redistribute(ranks, bus, [(mod(int(bus%nodes(i)) + 1, ranks_there), i=1, bus%n)], stat, msg)
    call ok('redistribute')
    call check('nodes of the owner', all([(any(bus%nodes == i), i=1, nodes)] .eqv. [(any(mine(1) == i), i=1, nodes)]))
    call fill()
    call bus%step(dt)
    call check('moved nodes', all(bus%temperature == expected(bus%nodes)))
    call bus%leave()

    ranks = shearbus_ranks()
    call shearbus_mpi_restart(ranks, MPI_COMM_WORLD, bus, '/nowhere', mine(2), endpoint=endpoint, stat=stat, msg=msg)
    call refused('no manifest', 301, '/nowhere cannot be read')
    call shearbus_mpi_restart(ranks, MPI_COMM_WORLD, bus, trim(directory)//'/fortran.tickets', mine(2), endpoint=endpoint, &
                              check_closure='off', stat=stat, msg=msg)
    call ok('restart')
    call check('nodes after the restart', bus%n == size(mine(2)))
    call fill()
    call bus%step(dt)
    call check('the step after the dump, again', all(bus%temperature == expected(bus%nodes)))
    call shearbus_mpi_close(ranks, bus, stat, msg)
    call ok('close')
  end subroutine

  subroutine on_root()
    call shearbus_mpi_open(ranks, MPI_COMM_WORLD, bus, mine(0), scene=scene, endpoint='embedded', check_closure='off', &
                           on_root=.true., stat=stat, msg=msg)
    call ok('open on root')
    call check('own rows', bus%n == size(mine(0)) .and. size(bus%pressure) == bus%n .and. (bus%is_open() .eqv. rank == 0))
    call fill()
    if (rank == ranks_there - 1) bus%pressure = [1.0_real64]
    call bus%step(dt, stat=stat, msg=msg)
    call refused('a short column of one rank', 105, 'pressure has the size 1')
    call fill()
    call bus%step(dt)
    call bus%step(dt, stat=stat, msg=msg)
    call ok('step on root')
    call check('answers', all(bus%temperature == expected(bus%nodes)) .and. all(bus%regime >= shearbus_regime_stick))
    call shearbus_mpi_close(ranks, bus, stat, msg)
    call ok('close on root')
    call bus%step(dt, stat=stat, msg=msg)
    call check('a step after the end', stat == 301)
  end subroutine
end program
