! The Fortran interface of the shearbus subgrid service (Fortran 2008): one source file, compiled with the host, over the C
! library libshearbus.so. It includes shearbus_contract.inc, which lies beside it. The interface carries its columns:
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
! quantities are in SI units. Columns that are answered on request, such as the energy ledger, come with every answer after
! call bus%want(['ledger']), or once the host has allocated them. An input that the host has not set is refused by name: it is NaN after open.
!
! Arguments of the calls:
!
!   ranks                  state of the MPI helpers, made by shearbus_mpi_open or shearbus_mpi_restart
!   comm                   communicator of the ranks, as the integer of the module mpi
!   bus                    interface of this rank
!   nodes                  ids of nodes, whole numbers from 0 on of 32 or 64 bits (resume and the MPI helpers: of 64); of an opening
!                          also the order of the columns
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
!   names                  of columns, as the components of the interface are named
!   profiles               of the layers, a column after the other
!   pressure               Pa, one value per node; absent: 0
!   dt                     s, length of the step, real64 as all reals: where a compiler promotes (-fdefault-real-8), that is 1e-9 and
!                          not 1d-9
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
!   law                    subroutine with the argument bus of class(shearbus_interface), which fills the columns of the answer
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
  include 'shearbus_contract.inc'
  integer, parameter, public :: shearbus_ticket_length = 65, shearbus_transfer_length = 32

  ! The nodes of an interface and the columns of its steps, one value per node. Names that end in 2 are the second component of
  ! a scene with tangential_components = 2. open allocates the inputs that the scene requires and the columns of every answer;
  ! a host allocates the other ones that it sends or wants, or names them to want. A step has the stick form if the host
  ! allocates impedance and stick_stress; then the stresses and masses of both sides are not sent.
  type, extends(columns_of_a_step) :: shearbus_columns
    integer :: n = 0                                 ! number of nodes
    integer(int64), allocatable :: nodes(:)          ! their ids, in the order of the columns
    integer(c_int8_t), allocatable :: regime(:)      ! shearbus_regime_...: what held the stress
    integer, allocatable :: outcome(:)               ! bits shearbus_outcome_...: what is remarkable of it
    integer :: flagged = 0                           ! rows of the last step whose outcome is neither 0 nor asleep
    real(real64) :: largest_closure = 0              ! m/s, largest difference of a jump from the one answered before
    real(real64) :: layer_time = 0                   ! s, sum of the dt of the steps of that node
  end type

  ! The layers of nodes at their vertices, in ascending z: arrays (vertices, nodes). NaN: the vertex lies outside of the layer and
  ! the quantity is one of the layer, or the scene does not have the quantity.
  type, public, extends(columns_of_a_profile) :: shearbus_profiles
    integer :: nodes = 0, vertices = 0
  end type

  type, extends(shearbus_columns) :: shearbus_interface
    procedure(own_law), pointer, nopass, private :: law => null()  ! of the host, and whether the last step needed it
    integer(c_int), pointer, private :: fell_back => null()
    type(c_ptr), private :: handle = c_null_ptr
    type(c_ptr), private :: ranks = c_null_ptr         ! of one session on root: the step of all ranks is then
    type(c_funptr), private :: step_of_all = c_null_funptr
    logical, private :: flags = .false.  ! an outcome may be other than 0
    integer(c_int8_t), allocatable, private :: bytes(:, :)  ! outcomes of the last answer, and regimes of masked rows
    type(columns_of_step), pointer, private :: started => null()  ! of a step between start and finish
  contains
    procedure, private :: open_32, open_64, step_plain, step_32, step_64, register_32, register_64, retire_32, retire_64, &
                          offer_32, offer_64, profiles_32, profiles_64, copy
    ! Opens a session with a layer for each node. Needs scene or scene_text.
    generic :: open => open_32, open_64
    ! Continues the session of a process that has ended. Nodes that are given must be in it with these pairs and parameters.
    procedure :: resume
    ! Makes one step of length dt with the columns of the interface.
    generic :: step => step_plain, step_32, step_64
    ! The same in two halves, for a host with other work to do while the server steps the layers: `start` sends the step,
    ! `finish` waits for the answer. Between the two no other call on the session but close and leave; the inputs may
    ! change, no column may be allocated anew. A step that was started and then left may run or not.
    procedure :: start
    procedure :: finish
    ! Allocates columns by their names, such as 'mean_shear_stress', so that every answer brings them; 'ledger': those of the
    ! energy ledger.
    procedure :: want
    ! Reads the profiles of nodes across the layer, from their committed states. pressure: at which the flow stress is evaluated.
    generic :: profiles => profiles_32, profiles_64
    ! Gives a law of the host for steps while the server is gone, if the user allows it by SHEARBUS_FALLBACK (shearbus.h).
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
    procedure, private, nopass :: clear, report, expect, tell, text_of, give_options, name_word, per_node, adopt_nodes, fields_of, &
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

  integer, parameter :: columns_at_most = 32
  type :: text_of_c
    character(kind=c_char, len=:), allocatable :: bytes
  end type
  type :: node_values                               ! what c_nodes points to
    integer(c_int64_t), allocatable :: ids(:), pair(:)
    real(c_double), allocatable :: temperatures(:), values(:, :)
    type(text_of_c), allocatable :: names(:), keys(:)
    type(c_ptr), allocatable :: names_at(:), keys_at(:), values_at(:)
  end type
  type :: column_pointer
    real(real64), pointer :: values(:)
  end type
  ! What a column is: an input of one form or of all, a column of the answer, or of its energy ledger.
  integer, parameter :: of_all_forms = 0, far_field = 1, stick_form = 2, answered = 3, in_ledger = 4
  ! A pass over the columns of doubles of an interface, which each_column makes: over the allocated ones, or over all.
  type, abstract :: column_visitor
    logical :: all
    integer :: at, field, component, role              ! of the column that is visited; at: the place of its name
  contains
    procedure(visit_column), deferred :: visit
  end type
  type, extends(column_visitor) :: columns_to_fit      ! of a session that was opened
    integer :: n
    integer(c_int32_t) :: fields(0:columns_at_most, 0:3)
  contains
    procedure :: visit => fit
  end type
  type, extends(column_visitor) :: columns_to_follow   ! of a set of nodes that has changed
    integer, allocatable :: row(:)                     ! of each node in the columns before, or 0
  contains
    procedure :: visit => follow
  end type
  type, extends(column_visitor) :: columns_to_want
    character(len=:), allocatable :: name
    integer :: n
    logical :: found
  contains
    procedure :: visit => allocate_named
  end type
  ! The columns of a step. Without initial values, which would be copied in every step.
  type, extends(column_visitor) :: columns_of_step
    integer :: n, count, n_in, n_out
    logical :: stick, masked
    integer, allocatable :: rows(:)                    ! that are stepped, of those of the interface
    real(c_double), allocatable :: in(:, :), out(:, :)
    type(c_input) :: inputs(columns_of_steps)
    type(c_output) :: outputs(columns_of_steps + 2)
    type(column_pointer) :: answers(columns_of_steps)
    real(c_double) :: nothing                          ! address of a column without rows
    logical :: direct                                  ! regimes are written where they stay
    integer(c_int64_t), allocatable :: ids(:)
    type(c_request) :: request
    type(c_result) :: answer
    integer(c_int) :: code
    type(c_status) :: status
  contains
    procedure :: visit => add_to_step
  end type

  abstract interface
    subroutine visit_column(visitor, column)
      import
      class(column_visitor), intent(inout), target :: visitor
      real(real64), allocatable, target, intent(inout) :: column(:)
    end subroutine
    subroutine own_law(bus)
      import
      class(shearbus_interface), intent(inout) :: bus
    end subroutine
  end interface
  interface
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
    call c_f_pointer(address, bytes, [c_strlen(address) + 1])
    text = text_of(bytes)
  end function

  ! Returns the text before the first NUL, which must be there.
  function text_of(bytes) result(text)
    character(kind=c_char), intent(in) :: bytes(:)
    character(len=:), allocatable :: text
    integer :: i
    allocate (character(len=findloc(bytes, c_null_char, dim=1) - 1) :: text)
    do i = 1, len(text)
      text(i:i) = bytes(i)
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
    flush (error_unit)  ! before the backtrace of error stop, in a file, too
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
    type(text_of_c), target :: texts(8)
    type(c_options) :: options
    call give_options(options, texts, scene, scene_text, endpoint, domain, name, server_key_file, secret_key_file, &
                      connect_deadline, reply_deadline, retry_after, state_dir, threads, check_closure, idle_limit)
    call enter(self, options, '', nodes, initial_temperature, pair, parameters, values, check_closure, stat, msg)
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
    call self%open(int(nodes, int64), scene, scene_text, endpoint, domain, initial_temperature, name, server_key_file, &
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
    class(*), intent(in), optional :: nodes(:)
    integer, intent(in), optional :: threads
    integer, intent(out), optional :: stat
    character(len=*), intent(inout), optional :: msg
    type(text_of_c), target :: texts(8)
    type(c_options) :: options
    type(c_status) :: status
    integer(c_int) :: code
    integer(int64), allocatable :: expected(:)
    allocate (expected(0))
    if (present(nodes)) then
      select type (nodes)
      type is (integer(int32))
        expected = nodes
      type is (integer(int64))
        expected = nodes
      class default
        call clear(status)
        call refuse_text(code, status, 'nodes are not whole numbers of 32 or 64 bits')
        call report(code, status, stat, msg)
        return
      end select
    end if
    call give_options(options, texts, endpoint=endpoint, name=name, server_key_file=server_key_file, &
                      secret_key_file=secret_key_file, connect_deadline=connect_deadline, reply_deadline=reply_deadline, &
                      retry_after=retry_after, state_dir=state_dir, threads=threads, check_closure=check_closure)
    call enter(self, options, ticket//c_null_char, expected, pair=pair, parameters=parameters, values=values, &
               check_closure=check_closure, stat=stat, msg=msg)
  end subroutine

  ! Opens a session, or resumes the one of the ticket.
  subroutine enter(self, options, ticket, nodes, initial_temperature, pair, parameters, values, check_closure, stat, msg)
    class(shearbus_interface), intent(inout), target :: self
    type(c_options), intent(in) :: options
    character(len=*), intent(in) :: ticket
    integer(int64), intent(in) :: nodes(:)
    real(real64), intent(in), optional :: initial_temperature(:), values(:, :)
    character(len=*), intent(in), optional :: pair(:), parameters(:), check_closure
    integer, intent(out), optional :: stat
    character(len=*), intent(inout), optional :: msg
    type(node_values), target :: held
    type(c_nodes) :: of
    type(c_status) :: status
    integer(c_int) :: code
    call clear(status)
    call give_nodes(of, held, nodes, initial_temperature, pair, parameters, values, code, status)
    if (code == 0 .and. len(ticket) > 0) then
      code = c_resume_nodes(self%handle, options, ticket, of, status)
    else if (code == 0) then
      code = c_open_nodes(self%handle, options, of, status)
    end if
    call name_word(code, status, check_closure)
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
    of%n_parameters = keys
    call per_node(initial_temperature, n, held%temperatures, of%initial_temperature_k, code, status)
    if (present(pair)) call expect(code, status, 'pair', size(pair), n)
    if (present(values)) then
      call expect(code, status, 'values, first dimension', size(values, 1), n)
      call expect(code, status, 'values, second dimension', size(values, 2), keys)
    else
      call expect(code, status, 'values, second dimension', 0, keys)
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
    type(text_of_c), intent(out), target :: texts(8)
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
    if (present(connect_deadline)) options%connect_deadline_s = connect_deadline
    if (present(reply_deadline)) options%reply_deadline_s = reply_deadline
    if (present(retry_after)) options%retry_after_s = retry_after
    if (present(threads)) options%threads = int(threads, c_int32_t)
    if (present(idle_limit)) options%idle_limit_s = idle_limit
    if (present(check_closure)) then  ! an unknown word is a number that the library refuses: name_word()
      options%check_closure = findloc([character(5) :: 'warn', 'off', 'error'], check_closure, dim=1) - 1
    end if
  end subroutine

  ! Names the unknown word in place of the number that the library has refused.
  subroutine name_word(code, status, check_closure)
    integer(c_int), intent(inout) :: code
    type(c_status), intent(inout) :: status
    character(len=*), intent(in), optional :: check_closure
    if (code /= shearbus_code_invalid_value .or. .not. present(check_closure)) return
    if (text_of(status%field) == 'check_closure') &
      call refuse_text(code, status, "check_closure is '"//trim(check_closure)//"', expected 'warn', 'off' or 'error'")
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
    call expect(code, status, 'initial_temperature', size(values), n)
    if (code /= 0) return
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

  ! Allocates the columns of a session, as NaN.
  subroutine make_columns(self, fields)
    type(shearbus_interface), intent(inout), target :: self
    integer(c_int32_t), intent(in) :: fields(0:columns_at_most, 0:3)
    type(columns_to_fit), target :: visitor
    visitor%all = .true.
    visitor%n = self%n
    visitor%fields = fields
    call each_column(self, visitor)
    if (allocated(self%regime)) deallocate (self%regime, self%outcome)
    allocate (self%regime(self%n), source=0_c_int8_t)
    allocate (self%outcome(self%n), source=0)
  end subroutine

  subroutine fit(visitor, column)
    class(columns_to_fit), intent(inout), target :: visitor
    real(real64), allocatable, target, intent(inout) :: column(:)
    integer :: use
    if (allocated(column)) deallocate (column)
    if (visitor%component == 1 .and. visitor%fields(0, 3) /= 2) return
    use = merge(2, 0, visitor%role >= answered)
    if (any(visitor%fields(1:visitor%fields(0, use), use) == visitor%field)) &
      allocate (column(visitor%n), source=unset())
  end subroutine

  function unset() result(value)
    real(real64) :: value
    value = ieee_value(value, ieee_quiet_nan)
  end function

  ! Shows each column of doubles to a visitor.
  subroutine each_column(self, visitor)
    type(shearbus_interface), intent(inout), target :: self
    class(column_visitor), intent(inout), target :: visitor
    visitor%at = 0
    ! print_contract.py: visits
    call show(self%jump, 10, 0, of_all_forms)
    call show(self%jump2, 10, 1, of_all_forms)
    call show(self%pressure, 11, 0, of_all_forms)
    call show(self%stress_soft, 12, 0, far_field)
    call show(self%stress_soft2, 12, 1, far_field)
    call show(self%stress_hard, 13, 0, far_field)
    call show(self%stress_hard2, 13, 1, far_field)
    call show(self%mass_soft, 14, 0, far_field)
    call show(self%mass_hard, 15, 0, far_field)
    call show(self%soft_shear_rate, 16, 0, of_all_forms)
    call show(self%soft_plastic_strain_rate, 17, 0, of_all_forms)
    call show(self%soft_plastic_strain_rate2, 17, 1, of_all_forms)
    call show(self%stick_stress, 18, 0, stick_form)
    call show(self%stick_stress2, 18, 1, stick_form)
    call show(self%impedance, 19, 0, stick_form)
    call show(self%stress, 30, 0, answered)
    call show(self%stress2, 30, 1, answered)
    call show(self%slip, 31, 0, answered)
    call show(self%slip2, 31, 1, answered)
    call show(self%temperature, 32, 0, answered)
    call show(self%jump_new, 33, 0, answered)
    call show(self%jump_new2, 33, 1, answered)
    call show(self%friction_heat, 36, 0, answered)
    call show(self%mean_shear_stress, 37, 0, answered)
    call show(self%mean_shear_stress2, 37, 1, answered)
    call show(self%stress_per_jump, 38, 0, answered)
    call show(self%stress_per_pressure, 39, 0, answered)
    call show(self%time_to_melting, 49, 0, answered)
    call show(self%interface_work, 40, 0, in_ledger)
    call show(self%heat_to_soft, 41, 0, in_ledger)
    call show(self%heat_to_hard, 42, 0, in_ledger)
    call show(self%plastic_work, 43, 0, in_ledger)
    call show(self%stored_heat_soft, 44, 0, in_ledger)
    call show(self%stored_heat_hard, 45, 0, in_ledger)
    call show(self%elastic_energy, 46, 0, in_ledger)
    call show(self%heat_residual, 47, 0, in_ledger)
    call show(self%energy_residual, 48, 0, in_ledger)
    call show(self%error_estimate, 60, 0, answered)
    call show(self%closure, 61, 0, answered)
    call show(self%closure2, 61, 1, answered)
    call show(self%film_thickness, 62, 0, answered)
    call show(self%mean_far_stress, 63, 0, answered)
    call show(self%friction_energy_soft, 70, 0, answered)
    call show(self%friction_energy_hard, 71, 0, answered)
    ! print_contract.py: end
  contains
    subroutine show(column, field, component, role)
      real(real64), allocatable, target, intent(inout) :: column(:)
      integer, intent(in) :: field, component, role
      visitor%at = visitor%at + 1
      if (.not. (allocated(column) .or. visitor%all)) return
      visitor%field = field
      visitor%component = component
      visitor%role = role
      call visitor%visit(column)
    end subroutine
  end subroutine

  subroutine want(self, names, stat, msg)
    class(shearbus_interface), intent(inout), target :: self
    character(len=*), intent(in) :: names(:)
    integer, intent(out), optional :: stat
    character(len=*), intent(inout), optional :: msg
    type(columns_to_want), target :: visitor
    type(c_status) :: status
    integer(c_int) :: code
    integer :: i
    call clear(status)
    code = 0
    visitor%all = .true.
    visitor%n = self%n
    do i = 1, size(names)
      visitor%name = trim(names(i))
      visitor%found = .false.
      call each_column(self, visitor)
      if (.not. visitor%found) then
        call refuse_text(code, status, 'no column of a step has the name '//visitor%name)
        exit
      end if
    end do
    call report(code, status, stat, msg)
  end subroutine

  subroutine allocate_named(visitor, column)
    class(columns_to_want), intent(inout), target :: visitor
    real(real64), allocatable, target, intent(inout) :: column(:)
    logical :: meant
    meant = names_of_columns(visitor%at) == visitor%name
    if (visitor%name == 'ledger') meant = visitor%role == in_ledger
    if (.not. meant) return
    visitor%found = .true.
    if (.not. allocated(column)) allocate (column(visitor%n), source=unset())
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
    integer(c_int) :: code
    call clear(status)
    code = c_close(self%handle, status)
    if (associated(self%started)) deallocate (self%started)
    call report(code, status, stat, msg)
  end subroutine

  subroutine leave(self)
    class(shearbus_interface), intent(inout) :: self
    call c_leave(self%handle)
    if (associated(self%started)) deallocate (self%started)
  end subroutine

  impure elemental subroutine finalise(self)
    type(shearbus_interface), intent(inout) :: self
    call drop(self)
  end subroutine

  ! Frees the handle, on which no call is made any more, and what it pointed to.
  subroutine drop(self)
    class(shearbus_interface), intent(inout) :: self
    call self%leave()
    if (associated(self%fell_back)) deallocate (self%fell_back)
    self%law => null()
  end subroutine

  subroutine copy(self, other)
    class(shearbus_interface), intent(inout) :: self
    type(shearbus_interface), intent(in) :: other
    if (c_associated(self%handle) .and. c_associated(self%handle, other%handle)) return  ! itself: a copy has no session
    call drop(self)
    self%shearbus_columns = other%shearbus_columns
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

  subroutine step_32(self, dt, time, n, trial, commit_previous, all_or_nothing, mask, open_absent, stat, msg)
    class(shearbus_interface), intent(inout), target :: self
    real(real64), intent(in) :: dt, time
    integer(int32), intent(in) :: n
    logical, intent(in), optional :: trial, commit_previous, all_or_nothing, open_absent, mask(:)
    integer, intent(out), optional :: stat
    character(len=*), intent(inout), optional :: msg
    call self%step(dt, time, int(n, int64), trial, commit_previous, all_or_nothing, mask, open_absent, stat, msg)
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
    call self%step(dt, end_time, 0_int64, trial, commit_previous, all_or_nothing, mask, open_absent, stat, msg)
  end subroutine

  subroutine step_64(self, dt, time, n, trial, commit_previous, all_or_nothing, mask, open_absent, stat, msg)
    class(shearbus_interface), intent(inout), target :: self
    real(real64), intent(in) :: dt, time
    integer(int64), intent(in) :: n
    logical, intent(in), optional :: trial, commit_previous, all_or_nothing, open_absent, mask(:)
    integer, intent(out), optional :: stat
    character(len=*), intent(inout), optional :: msg
    type(columns_of_step), target :: columns
    procedure(c_mpi_step_f), pointer :: step_all
    call prepare(self, columns, dt, time, n, trial, commit_previous, all_or_nothing, mask, open_absent)
    if (c_associated(self%step_of_all)) then
      call c_f_procpointer(self%step_of_all, step_all)
      columns%code = step_all(self%ranks, self%handle, columns%code, columns%request, columns%answer, columns%status)
    else if (columns%code == 0) then
      columns%code = c_step(self%handle, columns%request, columns%answer, columns%status)
    end if
    if (columns%code == 0) call adopt(self, columns)
    if (columns%code == 0 .and. associated(self%fell_back)) then
      if (self%fell_back /= 0) call ask_law(self, columns)
      self%fell_back = 0
    end if
    call report(columns%code, columns%status, stat, msg)
  end subroutine

  ! The host's own law answers a step. It fills whole columns; of a step with a mask, the rows stepped are taken.
  subroutine ask_law(self, columns)
    class(shearbus_interface), intent(inout) :: self
    type(columns_of_step), intent(in) :: columns
    real(real64), allocatable :: former(:, :)
    integer :: i, answered_columns
    answered_columns = merge(columns%n_out, 0, columns%masked)
    allocate (former(self%n, answered_columns))
    do i = 1, answered_columns
      former(:, i) = columns%answers(i)%values
    end do
    call self%law(self)
    do i = 1, answered_columns
      former(columns%rows, i) = columns%answers(i)%values(columns%rows)
      columns%answers(i)%values = former(:, i)
    end do
  end subroutine

  subroutine start(self, dt, time, trial, commit_previous, all_or_nothing, mask, open_absent, stat, msg)
    class(shearbus_interface), intent(inout), target :: self
    real(real64), intent(in) :: dt
    real(real64), intent(in), optional :: time
    logical, intent(in), optional :: trial, commit_previous, all_or_nothing, open_absent, mask(:)
    integer, intent(out), optional :: stat
    character(len=*), intent(inout), optional :: msg
    type(columns_of_step), pointer :: columns
    real(real64) :: end_time
    end_time = 0
    if (present(time)) end_time = time
    allocate (columns)
    call prepare(self, columns, dt, end_time, 0_int64, trial, commit_previous, all_or_nothing, mask, open_absent)
    if (c_associated(self%step_of_all)) call refuse_text(columns%code, columns%status, 'a session of all ranks steps in one call')
    if (columns%code == 0) columns%code = c_start(self%handle, columns%request, columns%status)
    if (columns%code == 0) self%started => columns
    call report(columns%code, columns%status, stat, msg)
    if (columns%code /= 0) deallocate (columns)
  end subroutine

  subroutine finish(self, stat, msg)
    class(shearbus_interface), intent(inout), target :: self
    integer, intent(out), optional :: stat
    character(len=*), intent(inout), optional :: msg
    type(columns_of_step), pointer :: columns
    columns => self%started
    if (.not. associated(columns)) then  ! the library refuses it
      allocate (columns)
      call clear(columns%status)
      columns%answer%size = c_sizeof(columns%answer)
    end if
    nullify (self%started)
    columns%code = c_finish(self%handle, columns%answer, columns%status)
    if (columns%code == 0) call adopt(self, columns)
    call report(columns%code, columns%status, stat, msg)
    deallocate (columns)
  end subroutine

  ! Makes the request of a step of the interface.
  subroutine prepare(self, columns, dt, time, n, trial, commit_previous, all_or_nothing, mask, open_absent)
    class(shearbus_interface), intent(inout), target :: self
    type(columns_of_step), intent(inout), target :: columns
    real(real64), intent(in) :: dt, time
    integer(int64), intent(in) :: n
    logical, intent(in), optional :: trial, commit_previous, all_or_nothing, open_absent, mask(:)
    integer :: i
    call clear(columns%status)
    columns%code = 0
    columns%all = .false.
    columns%n = self%n
    columns%count = self%n
    columns%n_in = 0
    columns%n_out = 0
    columns%stick = allocated(self%impedance) .or. allocated(self%stick_stress)  ! one alone is refused
    columns%masked = present(mask)
    if (columns%masked) then
      call expect(columns%code, columns%status, 'mask', size(mask), self%n)
      if (columns%code == 0) columns%rows = pack([(i, i=1, self%n)], mask)
      if (allocated(columns%rows)) columns%count = size(columns%rows)
      allocate (columns%in(max(columns%count, 1), columns_of_steps), columns%out(max(columns%count, 1), columns_of_steps))
    end if
    if (allocated(self%bytes) .and. .not. associated(self%started)) then
      if (size(self%bytes, 1) < columns%count) deallocate (self%bytes)
    end if
    if (.not. allocated(self%bytes)) allocate (self%bytes(max(columns%count, 1), 2), source=0_c_int8_t)
    columns%direct = .not. columns%masked .and. self%n > 0 .and. allocated(self%regime)
    if (columns%direct) columns%direct = size(self%regime) == self%n
    associate (request => columns%request)
      request%size = c_sizeof(request)
      request%dt_s = dt
      request%time_s = time
      request%step = n
      request%attempt = 0
      request%mode = number_of(trial)
      request%commit_previous = number_of(commit_previous)
      request%all_or_nothing = number_of(all_or_nothing)
      request%open_absent = number_of(open_absent)
      request%n = int(columns%count, c_size_t)
      request%node_ids = c_null_ptr
      if (allocated(columns%rows)) then
        columns%ids = [self%nodes(columns%rows), 0_c_int64_t]  ! one more, since an array without elements has no address
        request%node_ids = c_loc(columns%ids)
      end if
      call each_column(self, columns)
      columns%outputs(columns%n_out + 1) = c_output(outcome_column, 0, c_loc(self%bytes(1, 1)), 0)
      columns%outputs(columns%n_out + 2) = c_output(regime_column, 0, c_loc(self%bytes(1, 2)), 0)
      if (columns%direct) columns%outputs(columns%n_out + 2)%values = c_loc(self%regime(1))
      request%inputs = c_loc(columns%inputs)
      request%n_inputs = int(columns%n_in, c_size_t)
      request%outputs = c_loc(columns%outputs)
      request%n_outputs = int(columns%n_out + 2, c_size_t)
    end associate
    columns%answer%size = c_sizeof(columns%answer)
  end subroutine

  integer(c_int) function number_of(flag)
    logical, intent(in), optional :: flag
    number_of = 0
    if (.not. present(flag)) return
    if (flag) number_of = 1
  end function

  ! Takes over an answer. Rows that were not stepped keep their former answers, and so do those that the host's own law
  ! is about to answer.
  subroutine adopt(self, columns)
    class(shearbus_interface), intent(inout) :: self
    type(columns_of_step), intent(in) :: columns
    logical :: remarkable
    integer :: i
    self%flagged = int(columns%answer%flagged_nodes)
    self%largest_closure = columns%answer%largest_closure_m_per_s
    self%layer_time = columns%answer%layer_time_s
    if (.not. columns%masked) then
      if (.not. columns%direct) self%regime = self%bytes(:columns%count, 2)
      remarkable = any(self%bytes(:columns%count, 1) /= 0)
      if (remarkable) then
        self%outcome = iand(int(self%bytes(:columns%count, 1)), 255)
      else if (self%flags) then
        self%outcome = 0
      end if
      self%flags = remarkable
      return
    end if
    self%outcome(columns%rows) = iand(int(self%bytes(:columns%count, 1)), 255)
    self%flags = self%flags .or. any(self%bytes(:columns%count, 1) /= 0)
    if (associated(self%fell_back)) then
      if (self%fell_back /= 0) return
    end if
    self%regime(columns%rows) = self%bytes(:columns%count, 2)
    do i = 1, columns%n_out
      columns%answers(i)%values(columns%rows) = columns%out(:columns%count, i)
    end do
  end subroutine

  subroutine add_to_step(visitor, column)
    class(columns_of_step), intent(inout), target :: visitor
    real(real64), allocatable, target, intent(inout) :: column(:)
    type(c_ptr) :: values
    if (visitor%role == merge(far_field, stick_form, visitor%stick)) return
    if (size(column) /= visitor%n) &
      call expect(visitor%code, visitor%status, names_of_columns(visitor%at), size(column), visitor%n)
    if (visitor%code /= 0) return
    values = c_loc(visitor%nothing)
    if (visitor%count > 0 .and. .not. visitor%masked) values = c_loc(column)
    if (visitor%role < answered) then
      visitor%n_in = visitor%n_in + 1
      if (visitor%masked) then
        visitor%in(:visitor%count, visitor%n_in) = column(visitor%rows)
        values = c_loc(visitor%in(1, visitor%n_in))
      end if
      visitor%inputs(visitor%n_in) = c_input(visitor%field, visitor%component, values, 0)
    else
      visitor%n_out = visitor%n_out + 1
      visitor%answers(visitor%n_out)%values => column
      if (visitor%masked) values = c_loc(visitor%out(1, visitor%n_out))
      visitor%outputs(visitor%n_out) = c_output(visitor%field, visitor%component, values, 0)
    end if
  end subroutine

  ! ---- profiles ----

  subroutine profiles_64(self, nodes, profiles, pressure, stat, msg)
    class(shearbus_interface), intent(inout), target :: self
    integer(int64), intent(in) :: nodes(:)
    type(shearbus_profiles), intent(out), target :: profiles
    real(real64), intent(in), optional :: pressure(:)
    integer, intent(out), optional :: stat
    character(len=*), intent(inout), optional :: msg
    type(c_output) :: outputs(columns_of_profiles)
    real(c_double), allocatable, target :: pressures(:)
    type(c_ptr) :: at_pressure
    type(c_status) :: status
    integer(c_size_t) :: vertices
    integer(c_int) :: code
    integer(c_int32_t) :: fields(0:columns_at_most, 0:3)
    integer :: n_out
    call clear(status)
    code = 0
    at_pressure = c_null_ptr
    if (present(pressure)) then
      call expect(code, status, 'pressure', size(pressure), size(nodes))
      pressures = [pressure, 0.0_real64]  ! one more, since an array without elements has no address
      at_pressure = c_loc(pressures)
    end if
    vertices = 0
    if (code == 0) &
      code = c_profiles(self%handle, size(nodes, kind=c_size_t), nodes, at_pressure, outputs, 0_c_size_t, vertices, status)
    if (code == 0) then
      fields = fields_of(self)
      n_out = 0
      call take_all()
      code = c_profiles(self%handle, size(nodes, kind=c_size_t), nodes, at_pressure, outputs, int(n_out, c_size_t), vertices, &
                        status)
    end if
    if (code == 0) then
      profiles%nodes = size(nodes)
      profiles%vertices = int(vertices)
    end if
    call report(code, status, stat, msg)
  contains
    subroutine take_all()
      ! print_contract.py: profiles
      call take(profiles%position, 50, 0)
      call take(profiles%width, 51, 0)
      call take(profiles%layer_temperature, 52, 0)
      call take(profiles%layer_plastic_strain, 53, 0)
      call take(profiles%layer_flow_stress, 54, 0)
      call take(profiles%layer_shear_stress, 55, 0)
      call take(profiles%layer_shear_stress2, 55, 1)
      ! print_contract.py: end
    end subroutine
    subroutine take(values, field, component)
      real(real64), allocatable, target, intent(inout) :: values(:, :)
      integer, intent(in) :: field, component
      if (component == 1 .and. fields(0, 3) /= 2) return
      allocate (values(vertices, size(nodes)))
      n_out = n_out + 1
      outputs(n_out) = c_output(int(field, c_int32_t), int(component, c_int32_t), c_loc(values), 0)
    end subroutine
  end subroutine

  subroutine profiles_32(self, nodes, profiles, pressure, stat, msg)
    class(shearbus_interface), intent(inout), target :: self
    integer(int32), intent(in) :: nodes(:)
    type(shearbus_profiles), intent(out), target :: profiles
    real(real64), intent(in), optional :: pressure(:)
    integer, intent(out), optional :: stat
    character(len=*), intent(inout), optional :: msg
    call self%profiles(int(nodes, int64), profiles, pressure, stat, msg)
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
    class(shearbus_interface), intent(inout), target :: self
    integer(int64), allocatable :: before(:)
    type(columns_to_follow), target :: visitor
    integer :: i, j
    allocate (before, source=self%nodes)
    call adopt_nodes(self)
    visitor%all = .false.
    allocate (visitor%row(self%n), source=0)
    j = 1  ! the nodes that stay keep their order, so that both lists are walked once
    do i = 1, self%n
      do while (j <= size(before))
        if (before(j) == self%nodes(i)) exit
        j = j + 1
      end do
      if (j > size(before)) exit
      visitor%row(i) = j
      j = j + 1
    end do
    call each_column(self, visitor)
    self%regime = int(codes(int(self%regime)), c_int8_t)
    self%outcome = codes(self%outcome)
  contains
    function codes(column) result(values)
      integer, intent(in) :: column(:)
      integer :: values(self%n)
      integer :: k
      values = 0
      do k = 1, self%n
        if (visitor%row(k) > 0 .and. visitor%row(k) <= size(column)) values(k) = column(visitor%row(k))
      end do
    end function
  end subroutine

  subroutine follow(visitor, column)
    class(columns_to_follow), intent(inout), target :: visitor
    real(real64), allocatable, target, intent(inout) :: column(:)
    real(real64), allocatable :: values(:)
    integer :: k
    allocate (values(size(visitor%row)), source=unset())
    do k = 1, size(values)
      if (visitor%row(k) > 0 .and. visitor%row(k) <= size(column)) values(k) = column(visitor%row(k))
    end do
    call move_alloc(values, column)
  end subroutine

  ! Refuses what has not the size that it must have, unless there is a fault already.
  subroutine expect(code, status, name, found, expected)
    integer(c_int), intent(inout) :: code
    type(c_status), intent(inout) :: status
    character(len=*), intent(in) :: name
    integer, intent(in) :: found, expected
    if (code == 0 .and. found /= expected) call refuse(code, status, trim(name), found, expected)
  end subroutine

  subroutine refuse(code, status, name, found, expected)
    integer(c_int), intent(inout) :: code
    type(c_status), intent(inout) :: status
    character(len=*), intent(in) :: name
    integer, intent(in) :: found, expected
    character(len=200) :: text
    write (text, '(2a,i0,a,i0)') name, ' has the size ', found, ', expected ', expected
    call refuse_text(code, status, trim(text))
  end subroutine

  subroutine refuse_text(code, status, text)
    integer(c_int), intent(inout) :: code
    type(c_status), intent(inout) :: status
    character(len=*), intent(in) :: text
    code = shearbus_code_shape
    call tell(code, status, text)
  end subroutine

  subroutine tell(code, status, text)
    integer(c_int), intent(in) :: code
    type(c_status), intent(inout) :: status
    character(len=*), intent(in) :: text
    integer :: i
    status%code = code
    status%remedy(1) = c_null_char
    do i = 1, min(len(text), size(status%text) - 1)
      status%text(i) = text(i:i)
    end do
    status%text(i) = c_null_char
  end subroutine
end module
