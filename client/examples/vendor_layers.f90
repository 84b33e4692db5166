! What the templates for vendors' friction routines share: the sessions of a process, their restart with the host, and the
! step of a block of contact points in codes whose contact is a penalty (vfriction.f90, usrfrc.f90).
!
! The host's restart files know nothing of the layers. Where the host writes restart files, the states of the layers get a
! mark on the server, and KEY.shearbus in the working directory a ticket of the session with the marks and their times; the
! server keeps the newest two. The states of a contact are part of the host's restart files: a host that brings states for a
! contact without a session was restarted (in a new run they are zero), and goes on from the mark of its time. Without the
! file or the mark it stops and says so, instead of beginning with cold layers; SHEARBUS_COLD_LAYERS=1 in the environment
! allows those, with a warning. A ticket is a secret: the files are for their owner alone.
!
! The layers outlive the host only in a server of its own, that SHEARBUS_ENDPOINT names.
module vendor_layers
  use, intrinsic :: iso_c_binding, only: c_char, c_int, c_null_char
  use, intrinsic :: iso_fortran_env, only: error_unit, int64, real64
  use shearbus
  implicit none
  private
  public :: layers_of, end_increment, keep_layers, end_layers, step_of_block

  integer, parameter :: sessions_at_most = 32, marks_kept = 2
  ! Places of the states of a contact point that step_of_block keeps: slip rate and stress as vectors, number and length of the
  ! increment.
  integer, parameter, public :: v_before = 1, s_before = 4, counted = 7, dt_before = 8, states_of_block = 8
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
    call layers%bus%open(nodes=nodes, scene=scene, name=trim(key), check_closure='off', idle_limit=week)
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
      call layers%bus%resume(ticket, nodes=nodes, name=trim(layers%key), check_closure='off')
    else
      call layers%bus%resume(ticket, name=trim(layers%key), check_closure='off')
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

  ! Steps a block of contact points. A penalty knows no traction that would stop the slip: its force is that of a spring, which
  ! says nothing of the momentum. The stick form therefore comes from masses, which the model gives, and from the motion:
  !   the impedance        Z = 1/(dt (1/m_soft + 1/m_hard))    m per area: density times half the thickness of the zone at the
  !                                                            interface
  !   the slip rate        V                                    of this increment, before this friction acts
  !   what drives it       a = (V - V_before)/dt + s_before (1/m_soft + 1/m_hard)      of the increment before: the forces
  !                                                            of the bodies, which the routine does not get
  !   the stick stress     T = Z (V + dt a)
  ! So T lags by one increment: where the friction slides its stress does not depend on T, and the heat of an increment is
  ! that of a slip which is off by the change of a. In the first increment of a contact a = 0.
  ! points: ids of the nodes; one that is named twice has a layer for each contact. slip_rate and along: its size and its
  ! direction. masses: per area, of the soft side and the hard one. states(states_of_block, :) of the points, part of the
  ! host's restart files, and zero where a contact begins. time, dt and increment: end, length and number of the increment.
  ! stress: what friction has along the slip. It is noted in the states; a host that applies another one notes that.
  subroutine step_of_block(key, points, areas, normal_force, slip_rate, along, masses, time, dt, increment, states, stress)
    character(len=*), intent(in) :: key
    integer, intent(in) :: points(:), increment
    real(real64), intent(in) :: areas(:), normal_force(:), slip_rate(:), along(:, :), masses(2), time, dt
    real(real64), intent(inout) :: states(:, :)
    real(real64), intent(out) :: stress(:)
    type(contact_layers), pointer :: layers
    integer(int64) :: ids(size(points))
    integer :: row(size(points)), k, last
    logical, allocatable :: named(:)
    real(real64) :: compliance, drive
    last = size(along, 1) - 1
    compliance = 1/masses(1) + 1/masses(2)
    ids = points
    do k = 2, size(points)  ! a node that touches another surface, too: a layer of its own, of a node that no mesh has
      ids(k) = ids(k) + count(points(:k - 1) == points(k))*2_int64**40
    end do
    layers => layers_of(key, key//'.toml', ids, .false., any(states(counted, :) > 0), time - dt)
    stress = 0
    associate (bus => layers%bus)
      if (abs(layers%time - time) > 0) call end_increment(layers)  ! the first block of another increment
      layers%time = time
      layers%dt = dt
      call find_rows(layers, ids, row)
      allocate (named(bus%n), source=.false.)
      do k = 1, size(points)
        if (areas(k) <= 0) cycle
        named(row(k)) = .true.
        drive = 0
        if (states(counted, k) > 0 .and. nint(states(counted, k)) == increment - 1) &
          drive = (slip_rate(k) - dot_product(states(v_before:v_before + last, k), along(:, k)))/states(dt_before, k) + &
                  dot_product(states(s_before:s_before + last, k), along(:, k))*compliance
        bus%jump(row(k)) = slip_rate(k)
        bus%pressure(row(k)) = normal_force(k)/areas(k)
        bus%impedance(row(k)) = 1/(dt*compliance)
        bus%stick_stress(row(k)) = bus%impedance(row(k))*(slip_rate(k) + dt*drive)
      end do
      layers%touched = layers%touched .or. named
      call bus%step(dt, time, increment, mask=named)  ! a fault prints its text and stops the program
      do k = 1, size(points)
        if (areas(k) <= 0) cycle
        stress(k) = bus%stress(row(k))
        states(v_before:v_before + last, k) = slip_rate(k)*along(:, k)
        states(s_before:s_before + last, k) = stress(k)*along(:, k)
        states(counted, k) = increment
        states(dt_before, k) = dt
      end do
    end associate
  end subroutine

  ! The rows of nodes; new nodes are registered.
  subroutine find_rows(layers, ids, row)
    type(contact_layers), intent(inout) :: layers
    integer(int64), intent(in) :: ids(:)
    integer, intent(out) :: row(:)
    integer(int64), allocatable :: new(:)
    integer :: i
    associate (bus => layers%bus)
      do i = 1, size(ids)
        row(i) = findloc(bus%nodes, ids(i), dim=1)
      end do
      new = pack(ids, row == 0)
      if (size(new) > 0) then
        call bus%register(new)
        layers%touched = [layers%touched, [(.false., i=1, size(new))]]
        do i = 1, size(ids)
          if (row(i) == 0) row(i) = findloc(bus%nodes, ids(i), dim=1)
        end do
      end if
      if (.not. allocated(bus%impedance)) allocate (bus%impedance(bus%n), bus%stick_stress(bus%n), source=1.0_real64)
    end associate
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
    flush (error_unit)
    error stop 1
  end subroutine
end module
