! What the templates vfric.f90 and vfriction.f90 share: the sessions of a process, and their restart with the host.
!
! The host's restart files know nothing of the layers. Where Abaqus/Explicit writes restart files at the end of an increment
! (user subroutine VEXTERNALDB, below), the states of the layers get a mark on the server, and KEY.shearbus in the working
! directory a ticket of the session with the marks and their times; the server keeps the newest two. The states of a contact
! are part of the host's restart files: a host that brings states for a contact without a session was restarted (in a new
! run they are zero), and goes on from the mark of its time. Without the file or the mark it stops and says so, instead of
! beginning with cold layers; SHEARBUS_COLD_LAYERS=1 in the environment allows those, with a warning. A ticket is a secret:
! the files are for their owner alone.
!
! The layers outlive the host only in a server of its own, that SHEARBUS_ENDPOINT names.
!
! Documented by the vendor (user subroutine VEXTERNALDB) and not run here: its arguments, the numbers below, and that it is
! called after the other routines of an increment. Run here: this file, by callers of our own.
module abaqus_layers
  use, intrinsic :: iso_c_binding, only: c_char, c_int, c_null_char
  use, intrinsic :: iso_fortran_env, only: error_unit, int64, real64
  use shearbus
  implicit none
  private
  public :: layers_of, end_increment, keep_layers, end_layers

  integer, parameter :: sessions_at_most = 32, marks_kept = 2
  integer, parameter :: week = 604800  ! s, after which the server closes a session that no run has continued

  type, public :: contact_layers
    type(shearbus_interface) :: bus
    character(len=250) :: key = ''
    ! Of hosts that step an interaction in blocks: the nodes of the present increment, which the others follow at its end.
    logical, allocatable :: touched(:)
    real(real64) :: time = -1, dt = 0
    character(len=24), private :: marks(marks_kept) = ''
    real(real64), private :: times(marks_kept) = -1
    logical, private :: has_ticket = .false.
  end type
  type(contact_layers), save, target :: sessions(sessions_at_most)

  interface
    function c_umask(mask) bind(c, name='umask') result(before)
      import
      integer(c_int), value :: mask
      integer(c_int) :: before
    end function
    function c_rename(from, to) bind(c, name='rename') result(fault)
      import
      character(kind=c_char), intent(in) :: from(*), to(*)
      integer(c_int) :: fault
    end function
  end interface

contains

  ! The session of a contact, opened at its first call. key: its name; also that of its ticket. all_nodes: the nodes that the
  ! contact has, or some of them. restarted: the host brings states for it. begins: total time at which the increment begins.
  function layers_of(key, scene, nodes, all_nodes, restarted, begins) result(layers)
    character(len=*), intent(in) :: key, scene
    integer(int64), intent(in) :: nodes(:)
    logical, intent(in) :: all_nodes, restarted
    real(real64), intent(in) :: begins
    type(contact_layers), pointer :: layers
    character(len=8) :: allowed
    logical :: goes_on
    integer :: i
    do i = 1, sessions_at_most
      layers => sessions(i)
      if (layers%key == key) return
      if (layers%key == '') exit
    end do
    if (i > sessions_at_most) call fail('a process has more than 32 contacts', key)
    layers%key = key
    inquire (file=trim(key)//'.shearbus', exist=goes_on)
    call get_environment_variable('SHEARBUS_COLD_LAYERS', allowed)
    if (restarted .and. goes_on) then
      call resume(layers, nodes, all_nodes, begins)
      return
    end if
    if (restarted .and. allowed /= '1') &
      call fail('the host was restarted, and the ticket of its layers, '//trim(key)//'.shearbus, is not here: bring it from '// &
                'the directory of the first run, or set SHEARBUS_COLD_LAYERS=1 to begin with cold layers', key)
    if (restarted) call tell('warning: the host was restarted with cold layers, as SHEARBUS_COLD_LAYERS allows', key)
    call layers%bus%open(nodes=nodes, scene=scene, name='Abaqus '//trim(key), check_closure='off', idle_limit=week)
    allocate (layers%touched(layers%bus%n), source=.true.)
  end function

  subroutine resume(layers, nodes, all_nodes, begins)
    type(contact_layers), intent(inout) :: layers
    integer(int64), intent(in) :: nodes(:)
    logical, intent(in) :: all_nodes
    real(real64), intent(in) :: begins
    character(len=shearbus_ticket_length) :: ticket
    character(len=80) :: found
    integer :: unit, i, fault
    open (newunit=unit, file=trim(layers%key)//'.shearbus', action='read', status='old', iostat=fault)
    if (fault == 0) read (unit, '(a)', iostat=fault) ticket
    do i = 1, marks_kept
      if (fault == 0) read (unit, '(a24,es24.16)', iostat=fault) layers%marks(i), layers%times(i)
    end do
    if (fault /= 0) call fail('the ticket cannot be read: '//trim(layers%key)//'.shearbus', layers%key)
    close (unit)
    i = minloc(abs(layers%times - begins), dim=1)
    write (found, '(2es16.8,a,es16.8)') layers%times, ' s, and the host goes on from', begins
    if (abs(layers%times(i) - begins) > 1e-6_real64*begins) &
      call fail('no mark of the layers has the time of the restart: they have'//trim(found)//' s', layers%key)
    if (all_nodes) then
      call layers%bus%resume(ticket, nodes=nodes, name='Abaqus '//trim(layers%key), check_closure='off')
    else
      call layers%bus%resume(ticket, name='Abaqus '//trim(layers%key), check_closure='off')
    end if
    call layers%bus%rollback_to(layers%marks(i))
    call layers%bus%mark(layers%marks(i))
    if (all_nodes) then
      if (any(layers%bus%nodes /= nodes)) call fail('the nodes of the layers have another order than those of the host', layers%key)
    end if
    layers%has_ticket = .true.
    allocate (layers%touched(layers%bus%n), source=.true.)
    call tell('the layers go on from '//trim(layers%marks(i)), layers%key)
  end subroutine

  ! Nodes that no block of the increment has named were open in it, and cool.
  subroutine end_increment(layers)
    type(contact_layers), intent(inout) :: layers
    if (layers%dt > 0 .and. .not. all(layers%touched)) then
      where (.not. layers%touched)
        layers%bus%jump = 0
        layers%bus%pressure = 0
        layers%bus%stick_stress = 0
        layers%bus%impedance = 1
      end where
      call layers%bus%step(layers%dt, mask=.not. layers%touched)
    end if
    layers%dt = 0
    layers%touched = .false.
  end subroutine

  ! Marks the layers for a restart of the host from this time.
  subroutine keep_layers(time)
    real(real64), intent(in) :: time
    character(len=500) :: endpoint
    logical, save :: told = .false.
    integer :: i
    call get_environment_variable('SHEARBUS_ENDPOINT', endpoint)
    if (endpoint == '' .or. endpoint == 'embedded') then
      if (.not. told) call tell('the host writes restart files, and its layers end with this process: to restart with '// &
                                'them, name a server by SHEARBUS_ENDPOINT', sessions(1)%key)
      told = .true.
      return
    end if
    do i = 1, sessions_at_most
      if (sessions(i)%key == '') exit
      call end_increment(sessions(i))
      sessions(i)%marks = [sessions(i)%marks(2:), 't'//scientific(time)]
      sessions(i)%times = [sessions(i)%times(2:), time]
      call sessions(i)%bus%mark(sessions(i)%marks(marks_kept))
      call write_ticket(sessions(i))
    end do
  end subroutine

  ! The end of the run: sessions with a ticket stay for a restart.
  subroutine end_layers()
    integer :: i
    do i = 1, sessions_at_most
      if (sessions(i)%key == '') exit
      if (sessions(i)%has_ticket) then
        call sessions(i)%bus%leave()
      else
        call sessions(i)%bus%close()
      end if
      sessions(i)%key = ''
      deallocate (sessions(i)%touched)
    end do
  end subroutine

  subroutine write_ticket(layers)
    type(contact_layers), intent(inout) :: layers
    character(len=:), allocatable :: name
    integer(c_int) :: before
    integer :: unit, i, fault
    name = trim(layers%key)//'.shearbus'
    before = c_umask(int(o'077', c_int))
    open (newunit=unit, file=name//'.new', action='write', status='replace', iostat=fault)
    before = c_umask(before)
    if (fault == 0) write (unit, '(a)', iostat=fault) layers%bus%ticket()
    do i = 1, marks_kept
      if (fault == 0) write (unit, '(a24,es24.16)', iostat=fault) layers%marks(i), layers%times(i)
    end do
    if (fault == 0) close (unit, iostat=fault)
    if (fault == 0) fault = int(c_rename(name//'.new'//c_null_char, name//c_null_char))
    if (fault /= 0) call fail('the ticket of the layers cannot be written: '//name, layers%key)
    layers%has_ticket = .true.
  end subroutine

  function scientific(number) result(text)
    real(real64), intent(in) :: number
    character(len=23) :: text
    write (text, '(es23.16)') number
    text = adjustl(text)
  end function

  subroutine tell(what, key)
    character(len=*), intent(in) :: what, key
    write (error_unit, '(4a)') 'shearbus: ', trim(key), ': ', what
  end subroutine

  subroutine fail(what, key)
    character(len=*), intent(in) :: what, key
    call tell(what, key)
    error stop 1
  end subroutine
end module

subroutine vexternaldb(lOp, i_Array, niArray, r_Array, nrArray)
  use, intrinsic :: iso_fortran_env, only: real64
  use abaqus_layers
  implicit none
  integer, intent(in) :: lOp, niArray, nrArray
  integer, intent(inout) :: i_Array(niArray)
  real(real64), intent(inout) :: r_Array(nrArray)
  integer, parameter :: writes_restart = 6, total_time = 1                  ! places in the arrays
  integer, parameter :: end_of_increment = 4, end_of_analysis = 6           ! values of lOp
  if (lOp == end_of_increment .and. i_Array(writes_restart) == 1) call keep_layers(r_Array(total_time))
  if (lOp == end_of_analysis) call end_layers()
end subroutine
