! The Fortran interface of the shearbus subgrid service (Fortran 2008): one source file, compiled with the host, over the C
! library libshearbus.so. The interface carries its columns:
!
!   use shearbus
!   type(shearbus_interface) :: bus
!   call bus%open(scene='friction.toml', nodes=ids)           ! without an endpoint the server runs in this process
!   bus%jump = v_soft - v_hard;  bus%pressure = p             ! one value per node, in the order of nodes
!   bus%stress_soft = ...;  bus%mass_soft = ...               ! and hard: what the strategy of the scene requires
!   call bus%step(dt, time, n)
!   f_soft = f_soft - bus%stress*area;  f_hard = f_hard + bus%stress*area
!   call bus%close()
!
! Every call has stat and msg as in allocate: stat is 0 or the code of a fault (client/include/shearbus/shearbus.h), msg says
! what was expected and found, and what to do. A call without stat that fails prints this and stops the program. A call that
! fails changes nothing; after SHEARBUS_UNKNOWN_OUTCOME (501) the same call with the same values is the same request. All
! quantities are in SI units. An input that the host has not set is refused by name: it is NaN after open.
!
! Arguments of the calls:
!
!   ranks                  state of the MPI helpers, made by shearbus_mpi_open or shearbus_mpi_restart
!   comm                   communicator of the ranks, as the integer of the module mpi
!   bus                    interface of this rank
!   nodes                  ids of nodes, whole numbers from 0 on of 32 or 64 bits; of an opening also the order of the columns
!   scene                  path of a scene, a TOML file; or give scene_text
!   scene_text             text of a scene
!   endpoint               tcp://host:port, ipc://path or file://path of a server's endpoint file; several servers, with a comma
!                          between two of them or as the directory of their endpoint files, file://DIR, share the nodes; absent: the
!                          server runs in this process
!   domain                 sessions of one domain have distinct nodes, which can move between them
!   initial_temperature    K, one value per node; absent: that of the scene
!   name                   of the client, for the log of the server; of mark and rollback_to: of the mark
!   server_key_file        by tcp: file of the server's public key
!   secret_key_file        by tcp: file of the client's own secret key
!   connect_deadline       s, of the opening
!   reply_deadline         s, of every call, with its repetitions
!   retry_after            s, after which a request without an answer is sent again on a new connection
!   state_dir              directory in which a server in this process keeps its states
!   threads                number of threads of a server in this process
!   check_closure          'warn', 'error' or 'off': what a force-driven host meets whose jump is not the one that was answered
!   idle_limit             s, after which the server closes a session without requests; 0 or absent: never
!   pair                   name of a table [pair.NAME] of the scene for each node, blank for the tables outside of them
!   parameters             keys of the scene that have a value for each node, such as 'interface.friction_coefficient'
!   values                 (n, size(parameters)), in the units of the keys
!   ticket                 of the session that is to be continued
!   dt                     s, length of the step
!   time                   s, at the end of the step, for messages and recordings
!   n                      number of the host's step, for messages and recordings
!   trial                  the step waits for commit or rollback
!   commit_previous        keeps the trial that stands before this step
!   all_or_nothing         one node without an answer refuses the step for all
!   mask                   the rows that are stepped, one per node; absent: all
!   open_absent            the other rows are stepped without contact, so that they cool; absent: they stay as they are
!   transfer               32 hexadecimal digits, by which another session of the domain accepts what was offered
!   on_root                rank 0 alone has a session, and steps the nodes of all ranks
!   manifest               file with the tickets of all sessions, beside the host's dump
!   new_owner              rank of each node of bus, in the order of bus%nodes
!   mark                   name under which the server keeps the states
!   stat                   0, or the code of the fault
!   msg                    what was expected and found, and what to do
!
! A session that is not closed stays open on the server when its variable goes out of scope, so that its ticket can resume it.
! A copy of an interface has the columns, but no session.
module shearbus
  use, intrinsic :: iso_c_binding
  use, intrinsic :: iso_fortran_env, only: error_unit, int8, int32, int64, real64
  use, intrinsic :: ieee_arithmetic, only: ieee_value, ieee_quiet_nan
  implicit none
  private

  public :: shearbus_interface, shearbus_version
  ! Values of regime, and bits of outcome.
  integer, parameter, public :: shearbus_open_interface = 0, shearbus_stick = 1, shearbus_coulomb = 2, &
                                shearbus_tresca = 3, shearbus_melting = 4
  integer, parameter, public :: shearbus_substepped = 1, shearbus_multiple_roots = 2, shearbus_outside_domain = 4, &
                                shearbus_sudden = 8, shearbus_over_budget = 16, shearbus_asleep = 32, &
                                shearbus_first_order = 64, shearbus_failed = 128, &
                                shearbus_fallback = 160  ! all of it: the host's own law answered
  integer, parameter, public :: shearbus_ticket_length = 65, shearbus_transfer_length = 32

  type :: shearbus_interface
    integer :: n = 0                                 ! number of nodes
    integer(int64), allocatable :: nodes(:)          ! their ids, in the order of the columns
    ! Columns that the host sets before a step. Allocated by open: those that the scene requires. A host allocates the optional
    ! ones itself. Names that end in 2 are the second component of a scene with tangential_components = 2.
    real(real64), allocatable :: jump(:), jump2(:)                 ! m/s, V_soft - V_hard
    real(real64), allocatable :: pressure(:)                       ! Pa, compression positive
    real(real64), allocatable :: stress_soft(:), stress_soft2(:)   ! Pa, shear stress half a zone inside the soft body
    real(real64), allocatable :: stress_hard(:), stress_hard2(:)   ! Pa, shear stress half a zone inside the hard body
    real(real64), allocatable :: mass_soft(:), mass_hard(:)        ! kg/m2, of the half zone that moves with the interface
    ! The stick form of a force-driven step, used if the host allocates impedance; then the stresses and masses above are not.
    real(real64), allocatable :: stick_stress(:), stick_stress2(:) ! Pa, traction that would make the new jump zero
    real(real64), allocatable :: impedance(:)                      ! Pa s/m, 1/(dt (1/m_soft + 1/m_hard))
    real(real64), allocatable :: soft_shear_rate(:)                ! 1/s, optional
    real(real64), allocatable :: soft_plastic_strain_rate(:)       ! 1/s, optional
    ! Columns of the answer.
    real(real64), allocatable :: stress(:), stress2(:)             ! Pa, positive when the jump is
    real(real64), allocatable :: slip(:), slip2(:)                 ! m/s, sliding velocity
    real(real64), allocatable :: temperature(:)                    ! K
    real(real64), allocatable :: jump_new(:), jump_new2(:)         ! m/s, force-driven scenes
    real(real64), allocatable :: heat(:)                           ! J/m2, that entered the layer in the step
    ! Pa, optional: impulse of the stress over the step, divided by dt; asked for if the host allocates it
    real(real64), allocatable :: mean_stress(:), mean_stress2(:)
    ! Optional, asked for if the host allocates them: derivatives of stress by jump and pressure, time to T0 = T_melt.
    real(real64), allocatable :: stress_per_jump(:), stress_per_pressure(:) ! Pa s/m, 1
    real(real64), allocatable :: time_to_melting(:)                         ! s
    real(real64), allocatable :: film_thickness(:)                          ! m, of the melt; scenes with [melt_film]
    integer, allocatable :: regime(:), outcome(:)    ! values and bits above: what held the stress, what is remarkable of it
    integer :: flagged = 0                           ! rows of the last step whose outcome is not 0
    real(real64) :: closure = 0                      ! m/s, largest difference of a jump from the one answered before
    real(real64) :: layer_time = 0                   ! s, sum of the dt of the steps of that node
    procedure(own_law), pointer, nopass, private :: law => null()  ! of the host, and whether the last step needed it
    integer(c_int), pointer, private :: fell_back => null()
    type(c_ptr), private :: handle = c_null_ptr
    type(c_ptr), private :: ranks = c_null_ptr         ! of one session on root: the step of all ranks is then
    type(c_funptr), private :: step_of_all = c_null_funptr
    integer(c_int8_t), allocatable, private :: bytes(:, :)  ! regimes and outcomes of the last answer, as they are sent
  contains
    procedure, private :: open_32, open_64, step_plain, step_32, step_64, register_32, register_64, retire_32, retire_64, &
                          offer_32, offer_64, copy
    ! Opens a session with a layer for each node. Needs scene or scene_text.
    generic :: open => open_32, open_64
    ! Continues the session of a process that has ended. Nodes that are given must be in it with these pairs and parameters.
    procedure :: resume
    ! Makes one step of length dt with the columns of the interface.
    generic :: step => step_plain, step_32, step_64
    ! Gives the host's own law, which fills the columns of the answer while the server is gone, if the user allows it by
    ! SHEARBUS_FALLBACK (shearbus.h, shearbus_set_fallback). The rows of such a step have the outcome shearbus_fallback.
    procedure :: set_fallback
    ! Keeps the result of the trial.
    procedure :: commit
    ! Drops the trial.
    procedure :: rollback
    ! Keeps nodes and states on the server under a name, such as that of the host's dump.
    procedure :: mark
    ! Brings back the nodes and states of a mark.
    procedure :: rollback_to
    ! Adds nodes behind the present ones. parameters: those of the opening.
    generic :: register => register_32, register_64
    ! Removes nodes and their states.
    generic :: retire => retire_32, retire_64
    ! Offers nodes with their states to another session of the domain.
    generic :: offer => offer_32, offer_64
    ! Takes the nodes of an offer, behind the present ones.
    procedure :: accept
    ! Returns a secret by which another process resumes the session; blank: there is no session.
    procedure :: ticket
    ! Returns the scene with all defaults, as the server read it.
    procedure :: effective_scene
    ! Returns what the server remarks on the scene, a line each.
    procedure :: warnings
    ! Returns whether there is a session.
    procedure :: is_open
    ! Leaves the session open on the server, to be resumed by its ticket.
    procedure :: leave
    ! Closes the session and frees its states.
    procedure :: close
    generic :: assignment(=) => copy
    final :: finalise
  end type

  ! The ranks of an MPI run. The procedures are in client/mpi/shearbus_ranks.f90, which a host with MPI compiles, too; it says
  ! what they do.
  type, public :: shearbus_ranks
    private
    type(c_ptr) :: handle = c_null_ptr
  contains
    ! Bound here so that the submodule links to them: gfortran gives other private procedures no symbol.
    procedure, private, nopass :: clear, report, refuse, text_of, give_options, per_node, adopt_nodes, fields_of, &
                                  make_columns, follow_nodes
  end type
  public :: shearbus_mpi_open, shearbus_mpi_restart, shearbus_mpi_redistribute, shearbus_mpi_dump, shearbus_mpi_agree, &
            shearbus_mpi_close
  interface
    ! Opens sessions of all ranks in one domain, in which nodes can move.
    module subroutine shearbus_mpi_open(ranks, comm, bus, nodes, scene, scene_text, endpoint, domain, initial_temperature, &
                                        name, server_key_file, secret_key_file, connect_deadline, reply_deadline, &
                                        retry_after, state_dir, threads, check_closure, idle_limit, on_root, stat, msg)
      type(shearbus_ranks), intent(inout) :: ranks
      integer, intent(in) :: comm
      type(shearbus_interface), intent(inout), target :: bus
      integer(int64), intent(in) :: nodes(:)
      character(len=*), intent(in), optional :: scene, scene_text, endpoint, domain, name, server_key_file, secret_key_file, &
                                                state_dir, check_closure
      real(real64), intent(in), optional :: initial_temperature(:), connect_deadline, reply_deadline, retry_after
      integer, intent(in), optional :: threads, idle_limit
      logical, intent(in), optional :: on_root
      integer, intent(out), optional :: stat
      character(len=*), intent(inout), optional :: msg
    end subroutine
    ! Goes on from a dump, on any number of ranks; the ranks together ask for each node of the dump once.
    module subroutine shearbus_mpi_restart(ranks, comm, bus, manifest, nodes, endpoint, name, server_key_file, &
                                           secret_key_file, connect_deadline, reply_deadline, &
                                           retry_after, check_closure, idle_limit, stat, msg)
      type(shearbus_ranks), intent(inout) :: ranks
      integer, intent(in) :: comm
      type(shearbus_interface), intent(inout), target :: bus
      character(len=*), intent(in) :: manifest
      integer(int64), intent(in) :: nodes(:)
      character(len=*), intent(in), optional :: endpoint, name, server_key_file, secret_key_file, check_closure
      real(real64), intent(in), optional :: connect_deadline, reply_deadline, retry_after
      integer, intent(in), optional :: idle_limit
      integer, intent(out), optional :: stat
      character(len=*), intent(inout), optional :: msg
    end subroutine
    ! Moves nodes with their states to other ranks; what has come by a move has the input NaN until the host sets it.
    module subroutine shearbus_mpi_redistribute(ranks, bus, new_owner, stat, msg)
      type(shearbus_ranks), intent(in) :: ranks
      type(shearbus_interface), intent(inout) :: bus
      integer, intent(in) :: new_owner(:)
      integer, intent(out), optional :: stat
      character(len=*), intent(inout), optional :: msg
    end subroutine
    ! Marks the states of all sessions and writes the manifest for a restart.
    module subroutine shearbus_mpi_dump(ranks, bus, mark, manifest, stat, msg)
      type(shearbus_ranks), intent(in) :: ranks
      type(shearbus_interface), intent(inout) :: bus
      character(len=*), intent(in) :: mark, manifest
      integer, intent(out), optional :: stat
      character(len=*), intent(inout), optional :: msg
    end subroutine
    ! Gives all ranks the stat and msg of the lowest rank that was refused.
    module subroutine shearbus_mpi_agree(ranks, stat, msg)
      type(shearbus_ranks), intent(in) :: ranks
      integer, intent(inout) :: stat
      character(len=*), intent(inout) :: msg
    end subroutine
    ! Closes the sessions of all ranks.
    module subroutine shearbus_mpi_close(ranks, bus, stat, msg)
      type(shearbus_ranks), intent(inout) :: ranks
      type(shearbus_interface), intent(inout) :: bus
      integer, intent(out), optional :: stat
      character(len=*), intent(inout), optional :: msg
    end subroutine
  end interface

  ! ---- the C interface ----

  integer(c_size_t), parameter :: text_bytes = 2048, remedy_bytes = 512, field_bytes = 64
  integer, parameter :: columns_at_most = 32

  type, bind(c) :: c_status
    integer(c_size_t) :: size
    integer(c_int) :: code, n_nodes
    integer(c_int64_t) :: nodes(16)
    character(kind=c_char) :: field(field_bytes), remedy(remedy_bytes), text(text_bytes)
  end type
  type, bind(c) :: c_options
    integer(c_size_t) :: size
    type(c_ptr) :: endpoint, scene_file, scene_text, domain, name, server_key_file, secret_key_file
    real(c_double) :: connect_deadline_s, reply_deadline_s, retry_after_s
    type(c_funptr) :: log
    type(c_ptr) :: log_user, state_dir
    integer(c_int32_t) :: threads
    integer(c_int) :: check_closure
    integer(c_int64_t) :: idle_limit_s
    type(c_funptr) :: interrupted
    type(c_ptr) :: interrupted_user
  end type
  type :: c_text
    character(kind=c_char, len=:), allocatable :: bytes
  end type
  type, bind(c) :: c_nodes
    integer(c_size_t) :: size, n
    type(c_ptr) :: node_ids, initial_temperature_k
    integer(c_size_t) :: n_pairs
    type(c_ptr) :: pairs, pair
    integer(c_size_t) :: n_parameters
    type(c_ptr) :: parameters, values
  end type
  type :: node_values                               ! what c_nodes points to
    integer(c_int64_t), allocatable :: ids(:), pair(:)
    real(c_double), allocatable :: temperatures(:), values(:, :)
    type(c_text), allocatable :: names(:), keys(:)
    type(c_ptr), allocatable :: names_at(:), keys_at(:), values_at(:)
  end type
  type :: column_pointer
    real(real64), pointer :: values(:)
  end type
  type, bind(c) :: c_column
    integer(c_int32_t) :: field, component
    type(c_ptr) :: values
    integer(c_intptr_t) :: stride_bytes
  end type
  type, bind(c) :: c_request
    integer(c_size_t) :: size
    real(c_double) :: dt_s, time_s
    integer(c_int64_t) :: step
    integer(c_int32_t) :: attempt
    integer(c_int) :: mode, commit_previous, all_or_nothing
    integer(c_size_t) :: n
    type(c_ptr) :: node_ids, inputs
    integer(c_size_t) :: n_inputs
    type(c_ptr) :: outputs
    integer(c_size_t) :: n_outputs
    integer(c_int) :: open_absent
  end type
  type, bind(c) :: c_result
    integer(c_size_t) :: size
    integer(c_int64_t) :: nodes, flagged_nodes, state_version, solver_ns, service_ns, round_trip_ns
    real(c_double) :: largest_closure
    integer(c_int64_t) :: closure_node
    real(c_double) :: layer_time
    integer(c_int) :: replayed
  end type
  type, bind(c) :: c_info
    integer(c_size_t) :: size
    integer(c_int) :: strategy
    integer(c_int32_t) :: tangential_components
    integer(c_int64_t) :: bytes_per_node, last_sequence
    integer(c_int) :: outlives_server
    integer(c_int64_t) :: state_version, max_rows_per_message, max_marks
  end type

  abstract interface
    subroutine own_law(bus)
      import
      class(shearbus_interface), intent(inout) :: bus
    end subroutine
    ! A step of all ranks: `fault` is that of this rank before the step, which all ranks then report.
    function step_of_all_ranks(ranks, session, fault, request, result, status) bind(c) result(code)
      import
      type(c_ptr), value :: ranks, session
      integer(c_int), value :: fault
      type(c_request), intent(in) :: request
      type(c_result), intent(inout) :: result
      type(c_status), intent(inout) :: status
      integer(c_int) :: code
    end function
  end interface
  interface
    function c_open_nodes(session, options, nodes, status) bind(c, name='shearbus_open_nodes') result(code)
      import
      type(c_ptr), intent(inout) :: session
      type(c_options), intent(in) :: options
      type(c_nodes), intent(in) :: nodes
      type(c_status), intent(inout) :: status
      integer(c_int) :: code
    end function
    function c_resume_nodes(session, options, ticket, nodes, status) bind(c, name='shearbus_resume_nodes') result(code)
      import
      type(c_ptr), intent(inout) :: session
      type(c_options), intent(in) :: options
      character(kind=c_char), intent(in) :: ticket(*)
      type(c_nodes), intent(in) :: nodes
      type(c_status), intent(inout) :: status
      integer(c_int) :: code
    end function
    function c_close(session, status) bind(c, name='shearbus_close') result(code)
      import
      type(c_ptr), intent(inout) :: session
      type(c_status), intent(inout) :: status
      integer(c_int) :: code
    end function
    subroutine c_leave(session) bind(c, name='shearbus_leave')
      import
      type(c_ptr), intent(inout) :: session
    end subroutine
    function c_step(session, request, result, status) bind(c, name='shearbus_step') result(code)
      import
      type(c_ptr), value :: session
      type(c_request), intent(in) :: request
      type(c_result), intent(inout) :: result
      type(c_status), intent(inout) :: status
      integer(c_int) :: code
    end function
    function c_set_fallback(session, law, user, status) bind(c, name='shearbus_set_fallback') result(code)
      import
      type(c_ptr), value :: session
      type(c_funptr), value :: law
      type(c_ptr), value :: user
      type(c_status), intent(inout) :: status
      integer(c_int) :: code
    end function
    function c_commit(session, status) bind(c, name='shearbus_commit') result(code)
      import
      type(c_ptr), value :: session
      type(c_status), intent(inout) :: status
      integer(c_int) :: code
    end function
    function c_rollback(session, status) bind(c, name='shearbus_rollback') result(code)
      import
      type(c_ptr), value :: session
      type(c_status), intent(inout) :: status
      integer(c_int) :: code
    end function
    function c_mark(session, name, status) bind(c, name='shearbus_mark') result(code)
      import
      type(c_ptr), value :: session
      character(kind=c_char), intent(in) :: name(*)
      type(c_status), intent(inout) :: status
      integer(c_int) :: code
    end function
    function c_rollback_to(session, name, status) bind(c, name='shearbus_rollback_to') result(code)
      import
      type(c_ptr), value :: session
      character(kind=c_char), intent(in) :: name(*)
      type(c_status), intent(inout) :: status
      integer(c_int) :: code
    end function
    function c_register_nodes(session, nodes, status) bind(c, name='shearbus_register_nodes') result(code)
      import
      type(c_ptr), value :: session
      type(c_nodes), intent(in) :: nodes
      type(c_status), intent(inout) :: status
      integer(c_int) :: code
    end function
    function c_retire(session, n, ids, status) bind(c, name='shearbus_retire') result(code)
      import
      type(c_ptr), value :: session
      integer(c_size_t), value :: n
      integer(c_int64_t), intent(in) :: ids(*)
      type(c_status), intent(inout) :: status
      integer(c_int) :: code
    end function
    function c_offer(session, n, ids, transfer, status) bind(c, name='shearbus_offer') result(code)
      import
      type(c_ptr), value :: session
      integer(c_size_t), value :: n
      integer(c_int64_t), intent(in) :: ids(*)
      integer(c_int8_t), intent(out) :: transfer(16)
      type(c_status), intent(inout) :: status
      integer(c_int) :: code
    end function
    function c_accept(session, transfer, status) bind(c, name='shearbus_accept') result(code)
      import
      type(c_ptr), value :: session
      integer(c_int8_t), intent(in) :: transfer(16)
      type(c_status), intent(inout) :: status
      integer(c_int) :: code
    end function
    function c_ticket(session, ticket, status) bind(c, name='shearbus_ticket') result(code)
      import
      type(c_ptr), value :: session
      character(kind=c_char), intent(out) :: ticket(80)
      type(c_status), intent(inout) :: status
      integer(c_int) :: code
    end function
    function c_inspect(session, info, status) bind(c, name='shearbus_inspect') result(code)
      import
      type(c_ptr), value :: session
      type(c_info), intent(inout) :: info
      type(c_status), intent(inout) :: status
      integer(c_int) :: code
    end function
    function c_columns(session, use, capacity, fields) bind(c, name='shearbus_columns') result(count)
      import
      type(c_ptr), value :: session
      integer(c_int), value :: use
      integer(c_size_t), value :: capacity
      integer(c_int32_t), intent(inout) :: fields(*)
      integer(c_size_t) :: count
    end function
    function c_node_count(session) bind(c, name='shearbus_node_count') result(count)
      import
      type(c_ptr), value :: session
      integer(c_size_t) :: count
    end function
    function c_node_ids(session) bind(c, name='shearbus_node_ids') result(ids)
      import
      type(c_ptr), value :: session
      type(c_ptr) :: ids
    end function
    function c_effective_scene(session) bind(c, name='shearbus_effective_scene') result(text)
      import
      type(c_ptr), value :: session
      type(c_ptr) :: text
    end function
    function c_warnings(session) bind(c, name='shearbus_warnings') result(text)
      import
      type(c_ptr), value :: session
      type(c_ptr) :: text
    end function
    function c_code_name(code) bind(c, name='shearbus_code_name') result(text)
      import
      integer(c_int), value :: code
      type(c_ptr) :: text
    end function
    function c_version() bind(c, name='shearbus_version') result(text)
      import
      type(c_ptr) :: text
    end function
    function c_strlen(text) bind(c, name='strlen') result(length)
      import
      type(c_ptr), value :: text
      integer(c_size_t) :: length
    end function
  end interface

contains

  ! ---- texts and faults ----

  ! Returns the version of the library.
  function shearbus_version() result(text)
    character(len=:), allocatable :: text
    text = text_at(c_version())
  end function

  function text_at(address) result(text)
    type(c_ptr), intent(in) :: address
    character(len=:), allocatable :: text
    character(kind=c_char), pointer :: bytes(:)
    integer :: i
    call c_f_pointer(address, bytes, [c_strlen(address)])
    allocate (character(len=size(bytes)) :: text)
    do i = 1, size(bytes)
      text(i:i) = bytes(i)
    end do
  end function

  function text_of(bytes) result(text)
    character(kind=c_char), intent(in) :: bytes(:)
    character(len=:), allocatable :: text
    integer :: i
    text = ''
    do i = 1, size(bytes)
      if (bytes(i) == c_null_char) exit
      text = text//bytes(i)
    end do
  end function

  ! A C string, or nothing for an absent or blank text.
  subroutine to_c(text, bytes, address)
    character(len=*), intent(in), optional :: text
    character(kind=c_char, len=:), allocatable, target, intent(out) :: bytes
    type(c_ptr), intent(out) :: address
    address = c_null_ptr
    if (.not. present(text)) return
    if (len_trim(text) == 0) return
    bytes = trim(text)//c_null_char
    address = c_loc(bytes)
  end subroutine

  ! Makes a status ready for a call. A function would copy its 2.7 kB in every step.
  subroutine clear(status)
    type(c_status), intent(inout) :: status
    status%size = c_sizeof(status)
    status%code = 0
  end subroutine

  ! Gives the outcome of a call to the caller; stops the program if the call failed and the caller has no stat.
  subroutine report(code, status, stat, msg)
    integer(c_int), intent(in) :: code
    type(c_status), intent(in) :: status
    integer, intent(out), optional :: stat
    character(len=*), intent(inout), optional :: msg
    character(len=:), allocatable :: text
    if (present(stat)) stat = code
    if (code == 0) return
    text = text_at(c_code_name(code))//': '//text_of(status%text)
    if (status%remedy(1) /= c_null_char) text = text//' ('//text_of(status%remedy)//')'
    if (present(msg)) msg = text
    if (present(stat)) return
    write (error_unit, '(2a)') 'shearbus: ', text
    error stop 1
  end subroutine

  ! ---- opening and ending ----

  subroutine open_64(self, nodes, scene, scene_text, endpoint, domain, initial_temperature, name, server_key_file, &
                     secret_key_file, connect_deadline, reply_deadline, &
                     retry_after, state_dir, threads, check_closure, idle_limit, pair, parameters, values, stat, msg)
    class(shearbus_interface), intent(inout), target :: self
    integer(int64), intent(in) :: nodes(:)
    character(len=*), intent(in), optional :: scene, scene_text, endpoint, domain, name, server_key_file, secret_key_file, &
                                              state_dir, check_closure, pair(:), parameters(:)
    real(real64), intent(in), optional :: initial_temperature(:), connect_deadline, reply_deadline, retry_after, values(:, :)
    integer, intent(in), optional :: threads, idle_limit
    integer, intent(out), optional :: stat
    character(len=*), intent(inout), optional :: msg
    call enter(self, nodes, '', scene, scene_text, endpoint, domain, initial_temperature, name, server_key_file, &
               secret_key_file, connect_deadline, reply_deadline, &
               retry_after, state_dir, threads, check_closure, idle_limit, pair, parameters, values, stat, msg)
  end subroutine

  subroutine open_32(self, nodes, scene, scene_text, endpoint, domain, initial_temperature, name, server_key_file, &
                     secret_key_file, connect_deadline, reply_deadline, &
                     retry_after, state_dir, threads, check_closure, idle_limit, pair, parameters, values, stat, msg)
    class(shearbus_interface), intent(inout), target :: self
    integer(int32), intent(in) :: nodes(:)
    character(len=*), intent(in), optional :: scene, scene_text, endpoint, domain, name, server_key_file, secret_key_file, &
                                              state_dir, check_closure, pair(:), parameters(:)
    real(real64), intent(in), optional :: initial_temperature(:), connect_deadline, reply_deadline, retry_after, values(:, :)
    integer, intent(in), optional :: threads, idle_limit
    integer, intent(out), optional :: stat
    character(len=*), intent(inout), optional :: msg
    call enter(self, int(nodes, int64), '', scene, scene_text, endpoint, domain, initial_temperature, name, server_key_file, &
               secret_key_file, connect_deadline, reply_deadline, &
               retry_after, state_dir, threads, check_closure, idle_limit, pair, parameters, values, stat, msg)
  end subroutine

  subroutine resume(self, ticket, endpoint, name, server_key_file, secret_key_file, connect_deadline, reply_deadline, &
                    retry_after, state_dir, threads, check_closure, nodes, pair, parameters, values, stat, msg)
    class(shearbus_interface), intent(inout), target :: self
    character(len=*), intent(in) :: ticket
    character(len=*), intent(in), optional :: endpoint, name, server_key_file, secret_key_file, state_dir, check_closure, &
                                              pair(:), parameters(:)
    real(real64), intent(in), optional :: connect_deadline, reply_deadline, retry_after, values(:, :)
    integer(int64), intent(in), optional :: nodes(:)
    integer, intent(in), optional :: threads
    integer, intent(out), optional :: stat
    character(len=*), intent(inout), optional :: msg
    integer(int64), allocatable :: expected(:)
    allocate (expected(0))
    if (present(nodes)) expected = nodes
    call enter(self, expected, ticket//c_null_char, endpoint=endpoint, name=name, server_key_file=server_key_file, &
               secret_key_file=secret_key_file, connect_deadline=connect_deadline, reply_deadline=reply_deadline, &
               retry_after=retry_after, state_dir=state_dir, threads=threads, check_closure=check_closure, &
               pair=pair, parameters=parameters, values=values, stat=stat, msg=msg)
  end subroutine

  ! Opens a session, or resumes the one of the ticket.
  subroutine enter(self, nodes, ticket, scene, scene_text, endpoint, domain, initial_temperature, name, server_key_file, &
                   secret_key_file, connect_deadline, reply_deadline, &
                   retry_after, state_dir, threads, check_closure, idle_limit, pair, parameters, values, stat, msg)
    class(shearbus_interface), intent(inout), target :: self
    integer(int64), intent(in) :: nodes(:)
    character(len=*), intent(in) :: ticket
    character(len=*), intent(in), optional :: scene, scene_text, endpoint, domain, name, server_key_file, secret_key_file, &
                                              state_dir, check_closure, pair(:), parameters(:)
    real(real64), intent(in), optional :: initial_temperature(:), connect_deadline, reply_deadline, retry_after, values(:, :)
    integer, intent(in), optional :: threads, idle_limit
    integer, intent(out), optional :: stat
    character(len=*), intent(inout), optional :: msg
    type(c_text), target :: texts(8)
    type(node_values), target :: held
    type(c_nodes) :: of
    type(c_options) :: options
    type(c_status) :: status
    integer(c_int) :: code
    call clear(status)
    call give_options(options, texts, scene, scene_text, endpoint, domain, name, server_key_file, secret_key_file, &
                      connect_deadline, reply_deadline, retry_after, state_dir, threads, check_closure, idle_limit)
    call give_nodes(of, held, nodes, initial_temperature, pair, parameters, values, code, status)
    if (code == 0 .and. len(ticket) > 0) then
      code = c_resume_nodes(self%handle, options, ticket, of, status)
    else if (code == 0) then
      code = c_open_nodes(self%handle, options, of, status)
    end if
    if (code == 0) call adopt_nodes(self)
    if (code == 0) call make_columns(self, fields_of(self))
    call report(code, status, stat, msg)
  end subroutine

  ! The nodes of the C interface, which point into `held`.
  subroutine give_nodes(of, held, nodes, initial_temperature, pair, parameters, values, code, status)
    type(c_nodes), intent(out) :: of
    type(node_values), intent(out), target :: held
    integer(int64), intent(in) :: nodes(:)
    real(real64), intent(in), optional :: initial_temperature(:), values(:, :)
    character(len=*), intent(in), optional :: pair(:), parameters(:)
    integer(c_int), intent(out) :: code
    type(c_status), intent(inout) :: status
    integer :: n, keys, i
    n = size(nodes)
    keys = 0
    if (present(parameters)) keys = size(parameters)
    of%size = c_sizeof(of)
    of%n = n
    of%node_ids = c_null_ptr
    of%n_pairs = 0
    of%pairs = c_null_ptr
    of%pair = c_null_ptr
    of%n_parameters = keys
    of%parameters = c_null_ptr
    of%values = c_null_ptr
    call per_node(initial_temperature, n, held%temperatures, of%initial_temperature_k, code, status)
    if (code == 0 .and. present(pair)) then
      if (size(pair) /= n) call refuse(code, status, 'pair', size(pair), n)
    end if
    if (code == 0 .and. present(values)) then
      if (size(values, 1) /= n) call refuse(code, status, 'values, first dimension', size(values, 1), n)
      if (code == 0 .and. size(values, 2) /= keys) &
        call refuse(code, status, 'values, second dimension', size(values, 2), keys)
    else if (code == 0 .and. keys > 0) then
      call refuse(code, status, 'values, second dimension', 0, keys)
    end if
    if (code /= 0 .or. n == 0) return
    allocate (held%ids, source=nodes)
    of%node_ids = c_loc(held%ids)
    if (present(pair)) call give_pairs(of, held, pair)
    if (keys == 0) return
    allocate (held%keys(keys), held%keys_at(keys), held%values_at(keys))
    allocate (held%values, source=values)
    do i = 1, keys
      held%keys(i)%bytes = trim(parameters(i))//c_null_char
      held%keys_at(i) = c_loc(held%keys(i)%bytes)
      held%values_at(i) = c_loc(held%values(1, i))
    end do
    of%parameters = c_loc(held%keys_at)
    of%values = c_loc(held%values_at)
  end subroutine

  ! The distinct names of the nodes' pairs, and the place of each node's among them.
  subroutine give_pairs(of, held, pair)
    type(c_nodes), intent(inout) :: of
    type(node_values), intent(inout), target :: held
    character(len=*), intent(in) :: pair(:)
    integer :: i, place, names, first(size(pair))
    allocate (held%pair(size(pair)))
    names = 0
    do i = 1, size(pair)
      do place = 1, names
        if (pair(first(place)) == pair(i)) exit
      end do
      if (place > names) then
        names = place
        first(place) = i
      end if
      held%pair(i) = place - 1
    end do
    allocate (held%names(names), held%names_at(names))
    do i = 1, names
      held%names(i)%bytes = trim(pair(first(i)))//c_null_char
      held%names_at(i) = c_loc(held%names(i)%bytes)
    end do
    of%n_pairs = names
    of%pairs = c_loc(held%names_at)
    of%pair = c_loc(held%pair)
  end subroutine

  ! The options of the C interface, which point into `texts`.
  subroutine give_options(options, texts, scene, scene_text, endpoint, domain, name, server_key_file, secret_key_file, &
                          connect_deadline, reply_deadline, retry_after, state_dir, threads, check_closure, idle_limit)
    type(c_options), intent(out) :: options
    type(c_text), intent(out), target :: texts(8)
    character(len=*), intent(in), optional :: scene, scene_text, endpoint, domain, name, server_key_file, secret_key_file, &
                                              state_dir, check_closure
    real(real64), intent(in), optional :: connect_deadline, reply_deadline, retry_after
    integer, intent(in), optional :: threads, idle_limit
    options%size = c_sizeof(options)
    call to_c(endpoint, texts(1)%bytes, options%endpoint)
    call to_c(scene, texts(2)%bytes, options%scene_file)
    call to_c(scene_text, texts(3)%bytes, options%scene_text)
    call to_c(domain, texts(4)%bytes, options%domain)
    call to_c(name, texts(5)%bytes, options%name)
    call to_c(server_key_file, texts(6)%bytes, options%server_key_file)
    call to_c(secret_key_file, texts(7)%bytes, options%secret_key_file)
    call to_c(state_dir, texts(8)%bytes, options%state_dir)
    options%connect_deadline_s = 0
    options%reply_deadline_s = 0
    options%retry_after_s = 0
    options%log = c_null_funptr
    options%log_user = c_null_ptr
    options%threads = 0
    options%check_closure = 0
    options%idle_limit_s = 0
    options%interrupted = c_null_funptr
    options%interrupted_user = c_null_ptr
    if (present(connect_deadline)) options%connect_deadline_s = connect_deadline
    if (present(reply_deadline)) options%reply_deadline_s = reply_deadline
    if (present(retry_after)) options%retry_after_s = retry_after
    if (present(threads)) options%threads = int(threads, c_int32_t)
    if (present(idle_limit)) options%idle_limit_s = idle_limit
    if (present(check_closure)) then  ! an unknown word is a number that the library refuses
      options%check_closure = findloc([character(5) :: 'warn', 'off', 'error'], check_closure, dim=1) - 1
    end if
  end subroutine

  ! The address of one value per node, or of nothing where they are absent.
  subroutine per_node(values, n, copy, address, code, status)
    real(real64), intent(in), optional :: values(:)
    integer, intent(in) :: n
    real(c_double), allocatable, target, intent(out) :: copy(:)
    type(c_ptr), intent(out) :: address
    integer(c_int), intent(out) :: code
    type(c_status), intent(inout) :: status
    code = 0
    address = c_null_ptr
    if (.not. present(values)) return
    if (size(values) /= n) then
      call refuse(code, status, 'initial_temperature', size(values), n)
      return
    end if
    allocate (copy, source=values)
    if (n > 0) address = c_loc(copy)
  end subroutine

  ! The columns of a session's steps: required inputs, optional inputs and default outputs, each after their number; and
  ! the number of tangential components.
  function fields_of(self) result(fields)
    type(shearbus_interface), intent(in) :: self
    integer(c_int32_t) :: fields(0:columns_at_most, 0:3)
    type(c_info) :: info
    type(c_status) :: status
    integer :: use
    call clear(status)
    info%size = c_sizeof(info)
    fields = 0
    do use = 0, 2
      fields(0, use) = int(min(c_columns(self%handle, int(use, c_int), int(columns_at_most, c_size_t), fields(1:, use)), &
                               int(columns_at_most, c_size_t)), c_int32_t)
    end do
    fields(0, 3) = 1
    if (c_inspect(self%handle, info, status) == 0) fields(0, 3) = info%tangential_components
  end function

  ! Allocates the columns, the inputs as NaN.
  subroutine make_columns(self, fields)
    type(shearbus_interface), intent(inout), target :: self
    integer(c_int32_t), intent(in) :: fields(0:columns_at_most, 0:3)
    real(real64) :: unset
    logical :: two
    unset = ieee_value(unset, ieee_quiet_nan)
    two = fields(0, 3) == 2
    call fit(self%jump, has(0, 10))
    call fit(self%jump2, has(0, 10) .and. two)
    call fit(self%pressure, has(0, 11))
    call fit(self%stress_soft, has(0, 12))
    call fit(self%stress_soft2, has(0, 12) .and. two)
    call fit(self%stress_hard, has(0, 13))
    call fit(self%stress_hard2, has(0, 13) .and. two)
    call fit(self%mass_soft, has(0, 14))
    call fit(self%mass_hard, has(0, 15))
    call fit(self%stick_stress, .false.)
    call fit(self%stick_stress2, .false.)
    call fit(self%impedance, .false.)
    call fit(self%soft_shear_rate, .false.)
    call fit(self%soft_plastic_strain_rate, .false.)
    call fit(self%stress, has(2, 30))
    call fit(self%stress2, has(2, 30) .and. two)
    call fit(self%slip, has(2, 31))
    call fit(self%slip2, has(2, 31) .and. two)
    call fit(self%temperature, has(2, 32))
    call fit(self%jump_new, has(2, 33))
    call fit(self%jump_new2, has(2, 33) .and. two)
    call fit(self%heat, has(2, 36))
    call fit(self%mean_stress, .false.)
    call fit(self%mean_stress2, .false.)
    call fit(self%stress_per_jump, .false.)
    call fit(self%stress_per_pressure, .false.)
    call fit(self%time_to_melting, .false.)
    call fit(self%film_thickness, .false.)
    if (allocated(self%regime)) deallocate (self%regime, self%outcome)
    allocate (self%regime(self%n), self%outcome(self%n), source=0)
  contains
    function has(use, field) result(yes)
      integer, intent(in) :: use, field
      logical :: yes
      yes = any(fields(1:fields(0, use), use) == field)
    end function
    subroutine fit(column, wanted)
      real(real64), allocatable, intent(inout) :: column(:)
      logical, intent(in) :: wanted
      if (allocated(column)) deallocate (column)
      if (wanted) allocate (column(self%n), source=unset)
    end subroutine
  end subroutine

  subroutine adopt_nodes(self)
    type(shearbus_interface), intent(inout) :: self
    integer(c_int64_t), pointer :: ids(:)
    self%n = int(c_node_count(self%handle))
    if (allocated(self%nodes)) deallocate (self%nodes)
    allocate (self%nodes(self%n))
    if (self%n == 0) return
    call c_f_pointer(c_node_ids(self%handle), ids, [self%n])
    self%nodes = ids
  end subroutine

  function is_open(self) result(yes)
    class(shearbus_interface), intent(in) :: self
    logical :: yes
    yes = c_associated(self%handle)
  end function

  subroutine close(self, stat, msg)
    class(shearbus_interface), intent(inout) :: self
    integer, intent(out), optional :: stat
    character(len=*), intent(inout), optional :: msg
    type(c_status) :: status
    call clear(status)
    call report(c_close(self%handle, status), status, stat, msg)
  end subroutine

  subroutine leave(self)
    class(shearbus_interface), intent(inout) :: self
    call c_leave(self%handle)
  end subroutine

  impure elemental subroutine finalise(self)
    type(shearbus_interface), intent(inout) :: self
    call drop(self)
  end subroutine

  ! Frees the handle, on which no call is made any more, and what it pointed to.
  subroutine drop(self)
    class(shearbus_interface), intent(inout) :: self
    call c_leave(self%handle)
    if (associated(self%fell_back)) deallocate (self%fell_back)
    self%law => null()
  end subroutine

  subroutine copy(self, other)
    class(shearbus_interface), intent(inout) :: self
    type(shearbus_interface), intent(in) :: other
    call drop(self)
    self%n = other%n
    self%nodes = other%nodes
    call take(self%jump, other%jump)
    call take(self%jump2, other%jump2)
    call take(self%pressure, other%pressure)
    call take(self%stress_soft, other%stress_soft)
    call take(self%stress_soft2, other%stress_soft2)
    call take(self%stress_hard, other%stress_hard)
    call take(self%stress_hard2, other%stress_hard2)
    call take(self%mass_soft, other%mass_soft)
    call take(self%mass_hard, other%mass_hard)
    call take(self%stick_stress, other%stick_stress)
    call take(self%stick_stress2, other%stick_stress2)
    call take(self%impedance, other%impedance)
    call take(self%soft_shear_rate, other%soft_shear_rate)
    call take(self%soft_plastic_strain_rate, other%soft_plastic_strain_rate)
    call take(self%stress, other%stress)
    call take(self%stress2, other%stress2)
    call take(self%slip, other%slip)
    call take(self%slip2, other%slip2)
    call take(self%temperature, other%temperature)
    call take(self%jump_new, other%jump_new)
    call take(self%jump_new2, other%jump_new2)
    call take(self%heat, other%heat)
    call take(self%mean_stress, other%mean_stress)
    call take(self%mean_stress2, other%mean_stress2)
    call take(self%stress_per_jump, other%stress_per_jump)
    call take(self%stress_per_pressure, other%stress_per_pressure)
    call take(self%time_to_melting, other%time_to_melting)
    call take(self%film_thickness, other%film_thickness)
    if (allocated(other%regime)) then
      self%regime = other%regime
      self%outcome = other%outcome
    end if
    self%flagged = other%flagged
  contains
    subroutine take(to, from)
      real(real64), allocatable, intent(inout) :: to(:)
      real(real64), allocatable, intent(in) :: from(:)
      if (allocated(from)) then
        to = from
      else if (allocated(to)) then
        deallocate (to)
      end if
    end subroutine
  end subroutine

  function ticket(self) result(text)
    class(shearbus_interface), intent(in) :: self
    character(len=shearbus_ticket_length) :: text
    character(kind=c_char) :: bytes(80)
    type(c_status) :: status
    call clear(status)
    text = ''
    if (c_ticket(self%handle, bytes, status) == 0) text = text_of(bytes)
  end function

  function effective_scene(self) result(text)
    class(shearbus_interface), intent(in) :: self
    character(len=:), allocatable :: text
    text = text_at(c_effective_scene(self%handle))
  end function

  function warnings(self) result(text)
    class(shearbus_interface), intent(in) :: self
    character(len=:), allocatable :: text
    text = text_at(c_warnings(self%handle))
  end function

  ! ---- steps ----

  subroutine step_64(self, dt, time, n, trial, commit_previous, all_or_nothing, mask, open_absent, stat, msg)
    class(shearbus_interface), intent(inout), target :: self
    real(real64), intent(in) :: dt, time
    integer(int64), intent(in) :: n
    logical, intent(in), optional :: trial, commit_previous, all_or_nothing, open_absent, mask(:)
    integer, intent(out), optional :: stat
    character(len=*), intent(inout), optional :: msg
    call run(self, dt, time, n, trial, commit_previous, all_or_nothing, mask, open_absent, stat, msg)
  end subroutine

  subroutine step_32(self, dt, time, n, trial, commit_previous, all_or_nothing, mask, open_absent, stat, msg)
    class(shearbus_interface), intent(inout), target :: self
    real(real64), intent(in) :: dt, time
    integer(int32), intent(in) :: n
    logical, intent(in), optional :: trial, commit_previous, all_or_nothing, open_absent, mask(:)
    integer, intent(out), optional :: stat
    character(len=*), intent(inout), optional :: msg
    call run(self, dt, time, int(n, int64), trial, commit_previous, all_or_nothing, mask, open_absent, stat, msg)
  end subroutine

  subroutine step_plain(self, dt, time, trial, commit_previous, all_or_nothing, mask, open_absent, stat, msg)
    class(shearbus_interface), intent(inout), target :: self
    real(real64), intent(in) :: dt
    real(real64), intent(in), optional :: time
    logical, intent(in), optional :: trial, commit_previous, all_or_nothing, open_absent, mask(:)
    integer, intent(out), optional :: stat
    character(len=*), intent(inout), optional :: msg
    real(real64) :: end_time
    end_time = 0
    if (present(time)) end_time = time
    call run(self, dt, end_time, 0_int64, trial, commit_previous, all_or_nothing, mask, open_absent, stat, msg)
  end subroutine

  subroutine run(self, dt, time, n, trial, commit_previous, all_or_nothing, mask, open_absent, stat, msg)
    class(shearbus_interface), intent(inout), target :: self
    real(real64), intent(in) :: dt, time
    integer(int64), intent(in) :: n
    logical, intent(in), optional :: trial, commit_previous, all_or_nothing, open_absent, mask(:)
    integer, intent(out), optional :: stat
    character(len=*), intent(inout), optional :: msg
    type(c_column), target :: inputs(columns_at_most), outputs(columns_at_most)
    type(column_pointer) :: answers(columns_at_most)
    real(c_double), allocatable, target :: in(:, :), out(:, :)
    real(c_double), target :: nothing  ! address of a column without rows
    integer(c_int64_t), allocatable, target :: ids(:)
    integer, allocatable :: rows(:)
    type(c_request) :: request
    type(c_result) :: answer
    type(c_status) :: status
    procedure(step_of_all_ranks), pointer :: step_all
    integer(c_int) :: code
    logical :: masked
    integer :: i, count, n_in, n_out
    call clear(status)
    code = 0
    masked = present(mask)
    if (masked) then
      if (size(mask) /= self%n) call refuse(code, status, 'mask', size(mask), self%n)
      if (code == 0) rows = pack([(i, i=1, self%n)], mask)
    end if
    count = self%n
    if (allocated(rows)) count = size(rows)
    if (masked) allocate (in(max(count, 1), columns_at_most), out(max(count, 1), columns_at_most))
    if (allocated(self%bytes)) then
      if (size(self%bytes, 1) < count) deallocate (self%bytes)
    end if
    if (.not. allocated(self%bytes)) allocate (self%bytes(max(count, 1), 2))
    request%size = c_sizeof(request)
    request%dt_s = dt
    request%time_s = time
    request%step = n
    request%attempt = 0
    request%mode = number_of(trial)
    request%commit_previous = number_of(commit_previous)
    request%all_or_nothing = number_of(all_or_nothing)
    request%open_absent = number_of(open_absent)
    request%n = int(count, c_size_t)
    request%node_ids = c_null_ptr
    if (allocated(rows)) then
      ids = [self%nodes(rows), 0_c_int64_t]  ! one more, since an array without elements has no address
      request%node_ids = c_loc(ids)
    end if

    n_in = 0
    call give(self%jump, 'jump', 10, 0)
    call give(self%jump2, 'jump2', 10, 1)
    call give(self%pressure, 'pressure', 11, 0)
    if (allocated(self%impedance)) then
      call give(self%stick_stress, 'stick_stress', 18, 0)
      call give(self%stick_stress2, 'stick_stress2', 18, 1)
      call give(self%impedance, 'impedance', 19, 0)
    else
      call give(self%stress_soft, 'stress_soft', 12, 0)
      call give(self%stress_soft2, 'stress_soft2', 12, 1)
      call give(self%stress_hard, 'stress_hard', 13, 0)
      call give(self%stress_hard2, 'stress_hard2', 13, 1)
      call give(self%mass_soft, 'mass_soft', 14, 0)
      call give(self%mass_hard, 'mass_hard', 15, 0)
    end if
    call give(self%soft_shear_rate, 'soft_shear_rate', 16, 0)
    call give(self%soft_plastic_strain_rate, 'soft_plastic_strain_rate', 17, 0)
    n_out = 0
    call want(self%stress, 'stress', 30, 0)
    call want(self%stress2, 'stress2', 30, 1)
    call want(self%slip, 'slip', 31, 0)
    call want(self%slip2, 'slip2', 31, 1)
    call want(self%temperature, 'temperature', 32, 0)
    call want(self%jump_new, 'jump_new', 33, 0)
    call want(self%jump_new2, 'jump_new2', 33, 1)
    call want(self%heat, 'heat', 36, 0)
    call want(self%mean_stress, 'mean_stress', 37, 0)
    call want(self%mean_stress2, 'mean_stress2', 37, 1)
    call want(self%stress_per_jump, 'stress_per_jump', 38, 0)
    call want(self%stress_per_pressure, 'stress_per_pressure', 39, 0)
    call want(self%time_to_melting, 'time_to_melting', 49, 0)
    call want(self%film_thickness, 'film_thickness', 62, 0)
    outputs(n_out + 1) = c_column(34, 0, c_loc(self%bytes(1, 1)), 0)
    outputs(n_out + 2) = c_column(35, 0, c_loc(self%bytes(1, 2)), 0)
    request%inputs = c_loc(inputs)
    request%n_inputs = int(n_in, c_size_t)
    request%outputs = c_loc(outputs)
    request%n_outputs = int(n_out + 2, c_size_t)
    answer%size = c_sizeof(answer)
    if (c_associated(self%step_of_all)) then
      call c_f_procpointer(self%step_of_all, step_all)
      code = step_all(self%ranks, self%handle, code, request, answer, status)
    else if (code == 0) then
      code = c_step(self%handle, request, answer, status)
    end if
    if (code == 0) call adopt()
    if (code == 0 .and. associated(self%fell_back)) then
      if (self%fell_back /= 0) call self%law(self)
      self%fell_back = 0
    end if
    call report(code, status, stat, msg)
  contains
    function number_of(flag) result(number)
      logical, intent(in), optional :: flag
      integer(c_int) :: number
      number = 0
      if (.not. present(flag)) return
      if (flag) number = 1
    end function

    function is_sound(column, name) result(yes)
      real(real64), allocatable, intent(in) :: column(:)
      character(len=*), intent(in) :: name
      logical :: yes
      yes = allocated(column)
      if (.not. yes) return
      if (size(column) /= self%n) call refuse(code, status, name, size(column), self%n)
      yes = code == 0
    end function

    subroutine give(column, name, field, component)
      real(real64), allocatable, target, intent(in) :: column(:)
      character(len=*), intent(in) :: name
      integer, intent(in) :: field, component
      if (.not. is_sound(column, name)) return
      n_in = n_in + 1
      inputs(n_in) = c_column(int(field, c_int32_t), int(component, c_int32_t), c_loc(nothing), 0)
      if (masked) then
        in(:count, n_in) = column(rows)
        inputs(n_in)%values = c_loc(in(1, n_in))
      else if (count > 0) then
        inputs(n_in)%values = c_loc(column)
      end if
    end subroutine

    subroutine want(column, name, field, component)
      real(real64), allocatable, target, intent(inout) :: column(:)
      character(len=*), intent(in) :: name
      integer, intent(in) :: field, component
      if (.not. is_sound(column, name)) return
      n_out = n_out + 1
      outputs(n_out) = c_column(int(field, c_int32_t), int(component, c_int32_t), c_loc(nothing), 0)
      answers(n_out)%values => column
      if (masked) then
        outputs(n_out)%values = c_loc(out(1, n_out))
      else if (count > 0) then
        outputs(n_out)%values = c_loc(column)
      end if
    end subroutine

    ! Rows that were not stepped keep their former answers.
    subroutine adopt()
      self%flagged = int(answer%flagged_nodes)
      self%closure = answer%largest_closure
      self%layer_time = answer%layer_time
      if (.not. masked) then
        self%regime = iand(int(self%bytes(:count, 1)), 255)
        self%outcome = iand(int(self%bytes(:count, 2)), 255)
        return
      end if
      self%regime(rows) = iand(int(self%bytes(:count, 1)), 255)
      self%outcome(rows) = iand(int(self%bytes(:count, 2)), 255)
      do i = 1, n_out
        answers(i)%values(rows) = out(:count, i)
      end do
    end subroutine
  end subroutine

  ! ---- states and nodes ----

  subroutine set_fallback(self, law, stat, msg)
    class(shearbus_interface), intent(inout) :: self
    procedure(own_law) :: law
    integer, intent(out), optional :: stat
    character(len=*), intent(inout), optional :: msg
    type(c_status) :: status
    integer(c_int) :: code
    call clear(status)
    if (.not. associated(self%fell_back)) allocate (self%fell_back, source=0_c_int)
    code = c_set_fallback(self%handle, c_funloc(note_fallback), c_loc(self%fell_back), status)
    if (code == 0) self%law => law
    call report(code, status, stat, msg)
  end subroutine

  ! The law is called when the columns have the rows of the step.
  function note_fallback(user, request) bind(c) result(code)
    type(c_ptr), value :: user, request
    integer(c_int) :: code
    integer(c_int), pointer :: fell_back
    call c_f_pointer(user, fell_back)
    fell_back = merge(1_c_int, 0_c_int, c_associated(request))
    code = 0
  end function

  subroutine commit(self, stat, msg)
    class(shearbus_interface), intent(inout) :: self
    integer, intent(out), optional :: stat
    character(len=*), intent(inout), optional :: msg
    type(c_status) :: status
    call clear(status)
    call report(c_commit(self%handle, status), status, stat, msg)
  end subroutine

  subroutine rollback(self, stat, msg)
    class(shearbus_interface), intent(inout) :: self
    integer, intent(out), optional :: stat
    character(len=*), intent(inout), optional :: msg
    type(c_status) :: status
    call clear(status)
    call report(c_rollback(self%handle, status), status, stat, msg)
  end subroutine

  subroutine mark(self, name, stat, msg)
    class(shearbus_interface), intent(inout) :: self
    character(len=*), intent(in) :: name
    integer, intent(out), optional :: stat
    character(len=*), intent(inout), optional :: msg
    type(c_status) :: status
    call clear(status)
    call report(c_mark(self%handle, trim(name)//c_null_char, status), status, stat, msg)
  end subroutine

  subroutine rollback_to(self, name, stat, msg)
    class(shearbus_interface), intent(inout) :: self
    character(len=*), intent(in) :: name
    integer, intent(out), optional :: stat
    character(len=*), intent(inout), optional :: msg
    type(c_status) :: status
    integer(c_int) :: code
    call clear(status)
    code = c_rollback_to(self%handle, trim(name)//c_null_char, status)
    if (code == 0) call follow_nodes(self)
    call report(code, status, stat, msg)
  end subroutine

  subroutine register_64(self, nodes, initial_temperature, pair, parameters, values, stat, msg)
    class(shearbus_interface), intent(inout) :: self
    integer(int64), intent(in) :: nodes(:)
    real(real64), intent(in), optional :: initial_temperature(:), values(:, :)
    character(len=*), intent(in), optional :: pair(:), parameters(:)
    integer, intent(out), optional :: stat
    character(len=*), intent(inout), optional :: msg
    type(node_values), target :: held
    type(c_nodes) :: of
    type(c_status) :: status
    integer(c_int) :: code
    call clear(status)
    call give_nodes(of, held, nodes, initial_temperature, pair, parameters, values, code, status)
    if (code == 0) code = c_register_nodes(self%handle, of, status)
    if (code == 0) call follow_nodes(self)
    call report(code, status, stat, msg)
  end subroutine

  subroutine register_32(self, nodes, initial_temperature, pair, parameters, values, stat, msg)
    class(shearbus_interface), intent(inout) :: self
    integer(int32), intent(in) :: nodes(:)
    real(real64), intent(in), optional :: initial_temperature(:), values(:, :)
    character(len=*), intent(in), optional :: pair(:), parameters(:)
    integer, intent(out), optional :: stat
    character(len=*), intent(inout), optional :: msg
    call self%register(int(nodes, int64), initial_temperature, pair, parameters, values, stat, msg)
  end subroutine

  subroutine retire_64(self, nodes, stat, msg)
    class(shearbus_interface), intent(inout) :: self
    integer(int64), intent(in) :: nodes(:)
    integer, intent(out), optional :: stat
    character(len=*), intent(inout), optional :: msg
    type(c_status) :: status
    integer(c_int) :: code
    call clear(status)
    code = c_retire(self%handle, size(nodes, kind=c_size_t), nodes, status)
    if (code == 0) call follow_nodes(self)
    call report(code, status, stat, msg)
  end subroutine

  subroutine retire_32(self, nodes, stat, msg)
    class(shearbus_interface), intent(inout) :: self
    integer(int32), intent(in) :: nodes(:)
    integer, intent(out), optional :: stat
    character(len=*), intent(inout), optional :: msg
    call self%retire(int(nodes, int64), stat, msg)
  end subroutine

  ! transfer: 32 hexadecimal digits, for accept of another session of the domain.
  subroutine offer_64(self, nodes, transfer, stat, msg)
    class(shearbus_interface), intent(inout) :: self
    integer(int64), intent(in) :: nodes(:)
    character(len=shearbus_transfer_length), intent(out) :: transfer
    integer, intent(out), optional :: stat
    character(len=*), intent(inout), optional :: msg
    integer(c_int8_t) :: bytes(16)
    type(c_status) :: status
    integer(c_int) :: code
    call clear(status)
    transfer = ''
    code = c_offer(self%handle, size(nodes, kind=c_size_t), nodes, bytes, status)
    if (code == 0) then
      write (transfer, '(16z2.2)') iand(int(bytes), 255)
      call follow_nodes(self)
    end if
    call report(code, status, stat, msg)
  end subroutine

  subroutine offer_32(self, nodes, transfer, stat, msg)
    class(shearbus_interface), intent(inout) :: self
    integer(int32), intent(in) :: nodes(:)
    character(len=shearbus_transfer_length), intent(out) :: transfer
    integer, intent(out), optional :: stat
    character(len=*), intent(inout), optional :: msg
    call self%offer(int(nodes, int64), transfer, stat, msg)
  end subroutine

  ! The accepted nodes are the last ones of nodes.
  subroutine accept(self, transfer, stat, msg)
    class(shearbus_interface), intent(inout) :: self
    character(len=*), intent(in) :: transfer
    integer, intent(out), optional :: stat
    character(len=*), intent(inout), optional :: msg
    integer :: numbers(16), fault
    type(c_status) :: status
    integer(c_int) :: code
    call clear(status)
    code = 0
    fault = 1
    if (len_trim(transfer) == shearbus_transfer_length) read (transfer, '(16z2)', iostat=fault) numbers
    if (fault /= 0) then
      call refuse(code, status, 'transfer', len_trim(transfer), shearbus_transfer_length)
    else
      where (numbers > 127) numbers = numbers - 256
      code = c_accept(self%handle, int(numbers, c_int8_t), status)
    end if
    if (code == 0) call follow_nodes(self)
    call report(code, status, stat, msg)
  end subroutine

  ! Gives the columns the rows of the changed set of nodes; a node that was there before keeps its values.
  subroutine follow_nodes(self)
    class(shearbus_interface), intent(inout) :: self
    integer(int64), allocatable :: before(:)
    integer, allocatable :: row(:)
    real(real64) :: unset
    integer :: i, j
    unset = ieee_value(unset, ieee_quiet_nan)
    allocate (before, source=self%nodes)
    call adopt_nodes(self)
    allocate (row(self%n), source=0)
    j = 1  ! the nodes that stay keep their order, so that both lists are walked once
    do i = 1, self%n
      do while (j <= size(before))
        if (before(j) == self%nodes(i)) exit
        j = j + 1
      end do
      if (j > size(before)) exit
      row(i) = j
      j = j + 1
    end do
    call follow(self%jump)
    call follow(self%jump2)
    call follow(self%pressure)
    call follow(self%stress_soft)
    call follow(self%stress_soft2)
    call follow(self%stress_hard)
    call follow(self%stress_hard2)
    call follow(self%mass_soft)
    call follow(self%mass_hard)
    call follow(self%stick_stress)
    call follow(self%stick_stress2)
    call follow(self%impedance)
    call follow(self%soft_shear_rate)
    call follow(self%soft_plastic_strain_rate)
    call follow(self%stress)
    call follow(self%stress2)
    call follow(self%slip)
    call follow(self%slip2)
    call follow(self%temperature)
    call follow(self%jump_new)
    call follow(self%jump_new2)
    call follow(self%heat)
    call follow(self%mean_stress)
    call follow(self%mean_stress2)
    call follow(self%stress_per_jump)
    call follow(self%stress_per_pressure)
    call follow(self%time_to_melting)
    call follow(self%film_thickness)
    self%regime = codes(self%regime)
    self%outcome = codes(self%outcome)
  contains
    subroutine follow(column)
      real(real64), allocatable, intent(inout) :: column(:)
      real(real64), allocatable :: values(:)
      integer :: k
      if (.not. allocated(column)) return
      allocate (values(self%n), source=unset)
      do k = 1, self%n
        if (row(k) > 0 .and. row(k) <= size(column)) values(k) = column(row(k))
      end do
      call move_alloc(values, column)
    end subroutine
    function codes(column) result(values)
      integer, intent(in) :: column(:)
      integer :: values(self%n)
      integer :: k
      values = 0
      do k = 1, self%n
        if (row(k) > 0 .and. row(k) <= size(column)) values(k) = column(row(k))
      end do
    end function
  end subroutine

  ! A fault of this side: something has not the size that it must have.
  subroutine refuse(code, status, name, found, expected)
    integer(c_int), intent(inout) :: code
    type(c_status), intent(inout) :: status
    character(len=*), intent(in) :: name
    integer, intent(in) :: found, expected
    character(len=200) :: text
    integer :: i
    code = 105
    status%code = code
    write (text, '(2a,i0,a,i0)') name, ' has the size ', found, ', expected ', expected
    status%remedy(1) = c_null_char
    do i = 1, len_trim(text)
      status%text(i) = text(i:i)
    end do
    status%text(len_trim(text) + 1) = c_null_char
  end subroutine
end module
