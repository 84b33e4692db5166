! The MPI helpers of the Fortran interface (Fortran 2008): a submodule of client/fortran/shearbus.f90, which a host with
! MPI compiles after it, with client/mpi/shearbus_mpi.c. The CMake target is shearbus::mpi_fortran. shearbus_mpi.h says
! what each call does.
!
!   use mpi
!   use shearbus
!   type(shearbus_ranks) :: ranks
!   type(shearbus_interface) :: bus
!   call shearbus_mpi_open(ranks, MPI_COMM_WORLD, bus, scene='friction.toml', endpoint=..., nodes=my_ids)
!   call bus%step(dt, time, n, stat=stat, msg=msg)    ! of this rank's nodes
!   call shearbus_mpi_agree(ranks, stat, msg)         ! stat and msg of the lowest rank that was refused, on all ranks
!   call shearbus_mpi_redistribute(ranks, bus, new_owner) ! bus%nodes are other ones now; columns follow their nodes
!   call shearbus_mpi_dump(ranks, bus, 'dump_0042', 'dump_0042.tickets')
!   call shearbus_mpi_close(ranks, bus)
!
! comm is the integer of the module mpi; with mpi_f08 it is comm%mpi_val. Every call is collective, and has the same
! stat and msg on all ranks. With on_root=.true. rank 0 alone has a session, and bus%step is collective, with bus%nodes,
! bus%n and the columns of each rank's own nodes; rank 0 alone calls commit, rollback and mark. What has come by a move
! has the input NaN until the host sets it. A run that is stopped leaves its sessions on the server, for
! shearbus_mpi_restart.
submodule(shearbus) shearbus_mpi_ranks
  implicit none

contains

  ! on_root=.true.: one session, on rank 0.
  module procedure shearbus_mpi_open
    type(text_of_c), target :: texts(8)
    real(c_double), allocatable, target :: temperatures(:)
    integer(c_int32_t), target :: fields(0:columns_at_most, 0:3)
    type(c_ptr) :: temperatures_at
    type(c_options) :: options
    type(c_status) :: status
    integer(c_int) :: code, root
    call clear(status)
    root = 0
    if (present(on_root)) root = merge(1, 0, on_root)
    call give_options(options, texts, scene, scene_text, endpoint, domain, name, server_key_file, secret_key_file, &
                      connect_deadline, reply_deadline, retry_after, state_dir, threads, check_closure, idle_limit)
    call per_node(initial_temperature, size(nodes), temperatures, temperatures_at, code, status)
    code = c_mpi_open_f(ranks%handle, int(comm, c_int), code, root, bus%handle, options, size(nodes, kind=c_size_t), nodes, &
                      temperatures_at, status)
    call name_word(code, status, check_closure)
    if (code == 0 .and. root == 0) then
      call adopt_nodes(bus)
      call make_columns(bus, fields_of(bus))
    else if (code == 0) then
      bus%ranks = ranks%handle
      bus%step_of_all = c_funloc(c_mpi_step_f)
      bus%n = size(nodes)
      bus%nodes = nodes
      fields = 0
      if (bus%is_open()) fields = fields_of(bus)
      call c_mpi_share_f(ranks%handle, c_loc(fields), int(c_sizeof(fields), c_int))
      call make_columns(bus, fields)
    end if
    call report(code, status, stat, msg)
  end procedure

  module procedure shearbus_mpi_restart
    type(text_of_c), target :: texts(8)
    type(c_options) :: options
    type(c_status) :: status
    integer(c_int) :: code
    call clear(status)
    call give_options(options, texts, endpoint=endpoint, name=name, server_key_file=server_key_file, &
                      secret_key_file=secret_key_file, connect_deadline=connect_deadline, reply_deadline=reply_deadline, &
                      retry_after=retry_after, check_closure=check_closure, idle_limit=idle_limit)
    code = c_mpi_restart_f(ranks%handle, int(comm, c_int), bus%handle, options, trim(manifest)//c_null_char, &
                         size(nodes, kind=c_size_t), nodes, status)
    call name_word(code, status, check_closure)
    if (code == 0) call adopt_nodes(bus)
    if (code == 0) call make_columns(bus, fields_of(bus))
    call report(code, status, stat, msg)
  end procedure

  ! new_owner: the rank of each of bus%nodes.
  module procedure shearbus_mpi_redistribute
    type(c_status) :: status
    integer(c_int) :: code
    call clear(status)
    code = 0
    call expect(code, status, 'new_owner', size(new_owner), bus%n)
    code = c_mpi_agree(ranks%handle, code, status)
    if (code == 0) code = c_mpi_redistribute(ranks%handle, bus%handle, int(new_owner, c_int), status)
    if (bus%is_open() .and. .not. c_associated(bus%step_of_all)) call follow_nodes(bus)
    call report(code, status, stat, msg)
  end procedure

  module procedure shearbus_mpi_dump
    type(c_status) :: status
    call clear(status)
    call report(c_mpi_dump(ranks%handle, bus%handle, trim(mark)//c_null_char, trim(manifest)//c_null_char, status), status, &
                stat, msg)
  end procedure

  ! Gives all ranks the stat and the msg of the lowest rank whose stat is not 0.
  module procedure shearbus_mpi_agree
    type(c_status) :: status
    call clear(status)
    call tell(int(stat, c_int), status, trim(msg))
    stat = c_mpi_agree(ranks%handle, stat, status)
    if (stat /= 0) msg = text_of(status%text)
  end procedure

  module procedure shearbus_mpi_close
    type(c_status) :: status
    call clear(status)
    bus%step_of_all = c_null_funptr
    call report(c_mpi_close(ranks%handle, bus%handle, status), status, stat, msg)
  end procedure
end submodule
