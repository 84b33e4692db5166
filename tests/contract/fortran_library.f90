! The Fortran module against a live server: fortran_library SCENE.toml ENDPOINT. Every fault is printed; the program stops with an error if there is
! one.
program fortran_library
  use, intrinsic :: iso_fortran_env, only: error_unit, int32, int64, real64
  use shearbus
  implicit none
  integer, parameter :: n = 6
  character(len=1000) :: scene, endpoint, msg
  integer :: faults, stat, i
  faults = 0
  call get_command_argument(1, scene)
  call get_command_argument(2, endpoint)
  call bad_openings()
  call steps()
  call halves()
  call columns()
  call asleep()
  call stick_form()
  call moves()
  call scopes()
  call pairs()
  if (faults > 0) error stop 1
  print '(a)', 'the Fortran module keeps its contract'

contains

  subroutine check(what, is_so)
    character(len=*), intent(in) :: what
    logical, intent(in) :: is_so
    if (is_so) return
    faults = faults + 1
    write (error_unit, '(2a)') 'not so: ', what
  end subroutine

  subroutine ok(what)
    character(len=*), intent(in) :: what
    if (stat == 0) return
    faults = faults + 1
    write (error_unit, '(2a,i0,2a)') what, ' gave ', stat, ': ', trim(msg)
  end subroutine

  subroutine refused(what, code, word)
    character(len=*), intent(in) :: what, word
    integer, intent(in) :: code
    if (stat == code .and. index(msg, word) > 0) return
    faults = faults + 1
    write (error_unit, '(2a,i0,3a,i0,3a)') what, ' gave ', stat, ' "', trim(msg), '", expected ', code, ' "', word, '"'
  end subroutine

  subroutine open_six(bus, first, domain)
    type(shearbus_interface), intent(inout) :: bus
    integer(int64), intent(in) :: first
    character(len=*), intent(in), optional :: domain
    ! The steps of this program apply no answer.
    call bus%open(nodes=[(first + 7*i, i=1, n)], scene=scene, endpoint=endpoint, domain=domain, check_closure='off', &
                  idle_limit=3600, stat=stat, msg=msg)
    call ok('open')
    if (stat /= 0) error stop 1
    call fill(bus)
  end subroutine

  subroutine fill(bus)
    type(shearbus_interface), intent(inout) :: bus
    bus%jump = [(90.0_real64 + i, i=1, n)]
    bus%pressure = [(2e8_real64*(1 + mod(i, 3)), i=1, n)]
    bus%stress_soft = [(1e6_real64*i, i=1, n)]
    bus%stress_hard = -bus%stress_soft
    bus%mass_soft = [(4e-3_real64, i=1, n)]
    bus%mass_hard = [(12e-3_real64, i=1, n)]
  end subroutine

  subroutine bad_openings()
    type(shearbus_interface) :: bus
    call bus%open(scene='/nowhere.toml', nodes=[1, 2], endpoint=endpoint, stat=stat, msg=msg)
    call refused('no file', 300, '/nowhere.toml: cannot be opened')
    call bus%open(scene_text='[layer]'//new_line('a')//'cels = 3', nodes=[1, 2], endpoint=endpoint, stat=stat, msg=msg)
    call refused('a bad scene', 300, 'scene_text:2:1')
    call bus%open(scene=scene, nodes=[1, 1], endpoint=endpoint, stat=stat, msg=msg)
    call refused('a doubled node', 303, 'DUPLICATE_NODE')
    call bus%open(scene=scene, nodes=[1, 2], initial_temperature=[300.0_real64], endpoint=endpoint, stat=stat, msg=msg)
    call refused('temperatures', 105, 'initial_temperature has the size 1, expected 2')
    call bus%open(scene=scene, nodes=[1], check_closure='maybe', endpoint=endpoint, stat=stat, msg=msg)
    call refused('a word', 105, "check_closure is 'maybe', expected 'warn', 'off' or 'error'")
    call bus%open(scene=scene, nodes=[1], endpoint='ipc:///nowhere', connect_deadline=0.2_real64, stat=stat, msg=msg)
    call refused('no server', 500, 'UNREACHABLE')
    call bus%open(scene=scene, nodes=[1], endpoint=endpoint, retry_after=-3.0_real64, stat=stat, msg=msg)
    call refused('the time of repetition', 301, 'retry_after_s is -3')
    call check('no session', .not. bus%is_open() .and. bus%ticket() == '')
    call bus%step(1e-9_real64, stat=stat, msg=msg)
    call refused('a step', 301, 'there is no session')
    call bus%close(stat, msg)
    call ok('close of nothing')
  end subroutine

  subroutine steps()
    type(shearbus_interface) :: bus, copy
    real(real64) :: first(n), second(n), kept(n), strided(3*n)
    logical :: touching(n)
    call open_six(bus, 100_int64)
    call check('nodes', bus%n == n .and. bus%nodes(2) == 114)
    call check('scene', index(bus%effective_scene(), 'thickness_m = ') > 0)
    call bus%mark('start', stat, msg)
    call ok('mark')
    call bus%step(1e-9_real64, 1e-9_real64, 1, stat=stat, msg=msg)
    call ok('step')
    first = bus%temperature
    call check('answers', all(bus%stress > 0 .and. bus%temperature > 300 .and. bus%jump_new < bus%jump .and. bus%friction_heat > 0))
    call check('codes', all(bus%regime >= shearbus_regime_stick .and. bus%regime <= shearbus_regime_melting .and. bus%outcome == 0))
    allocate (bus%mean_shear_stress(n), source=-1.0_real64)
    call bus%step(1e-9_real64, 2e-9_real64, 2_int64, stat=stat, msg=msg)
    call ok('step with a long number')
    call check('mean stress of a force-driven step', all(bus%mean_shear_stress == bus%stress))
    deallocate (bus%mean_shear_stress)
    second = bus%temperature
    call further_columns(bus)

    call bus%rollback_to('start', stat, msg)
    call ok('rollback_to')
    bus%temperature = -1
    touching = [(mod(i, 2) == 0, i=1, n)]
    call bus%step(1e-9_real64, mask=touching, stat=stat, msg=msg)
    call ok('step of some nodes')
    call check('rows of the mask', all(merge(bus%temperature == first, bus%temperature == -1, touching)))
    call bus%step(1e-9_real64, mask=.not. touching, stat=stat, msg=msg)
    call ok('step of the others')
    call check('all rows', all(bus%temperature == first))

    ! Nodes that are not named keep their states, or cool.
    kept = 0
    do i = 0, 1
      call bus%rollback_to('start')
      call bus%step(1e-9_real64)
      call bus%step(1e-9_real64, mask=touching, open_absent=i == 1, stat=stat, msg=msg)
      call ok('step with absent nodes')
      call bus%step(1e-9_real64)
      if (i == 0) kept = bus%temperature
    end do
    call check('absent nodes are kept', all(kept == second .or. touching))
    call check('absent nodes cool', all(merge(bus%temperature == kept, bus%temperature < kept, touching)))

    call bus%rollback_to('start')
    call bus%step(1e-9_real64)
    bus%jump = bus%jump/2
    call bus%step(1e-9_real64, trial=.true., stat=stat, msg=msg)
    call ok('trial')
    call bus%rollback(stat, msg)
    call ok('rollback')
    strided = -1
    strided(::3) = [(90.0_real64 + i, i=1, n)]
    bus%jump = strided(::3)
    call bus%step(1e-9_real64, trial=.true., stat=stat, msg=msg)
    call bus%commit(stat, msg)
    call ok('commit')
    call check('a trial leaves no trace', all(bus%temperature == second))

    copy = bus
    call check('a copy has no session', .not. copy%is_open() .and. all(copy%temperature == second))
    call copy%step(1e-9_real64, stat=stat, msg=msg)
    call refused('a copy', 301, 'there is no session')
    call bus%close(stat, msg)
    call ok('close')
    call check('closed', .not. bus%is_open())
  end subroutine

  ! A step that is started and finished has the answers of a whole one.
  subroutine halves()
    type(shearbus_interface) :: bus, whole
    logical :: touching(n)
    integer :: k
    call open_six(bus, 400_int64)
    call open_six(whole, 500_int64)
    touching = [(mod(i, 2) == 0, i=1, n)]
    do k = 1, 3
      if (k < 3) then
        call bus%start(1e-9_real64, 1e-9_real64*k, trial=k == 2, stat=stat, msg=msg)
        call whole%step(1e-9_real64, 1e-9_real64*k, trial=k == 2)
      else
        call bus%start(1e-9_real64, mask=touching, stat=stat, msg=msg)
        call whole%step(1e-9_real64, mask=touching)
      end if
      call ok('start')
      bus%jump = 0  ! is the host's again
      call bus%step(1e-9_real64, stat=stat, msg=msg)
      call refused('a step before the end of another', 301, 'a started step has not been finished')
      call bus%start(1e-9_real64, stat=stat, msg=msg)
      call refused('a second start', 301, 'a started step has not been finished')
      call bus%commit(stat, msg)
      call refused('a commit before the end of a step', 301, 'a started step has not been finished')
      call bus%finish(stat, msg)
      call ok('finish')
      call check('halves', all(bus%stress == whole%stress .and. bus%temperature == whole%temperature .and. &
                               bus%regime == whole%regime .and. bus%outcome == whole%outcome))
      call fill(bus)
      if (k == 2) then
        call bus%commit(stat, msg)
        call ok('commit of halves')
        call whole%commit()
      end if
    end do
    call bus%finish(stat, msg)
    call refused('an end without a start', 301, 'a step is finished that was not started')
    call bus%start(1e-9_real64)
    call bus%close(stat, msg)
    call ok('close behind a start')
    call whole%start(1e-9_real64)  ! and is left so
  end subroutine

  ! What an author gets wrong.
  subroutine columns()
    type(shearbus_interface) :: bus
    call open_six(bus, 200_int64)
    bus%pressure(4) = bus%pressure(4)/0
    call bus%step(1e-9_real64, stat=stat, msg=msg)
    call refused('an infinite pressure', 301, 'pressure_pa')
    bus%pressure = [1e8_real64, 2e8_real64]
    call bus%step(1e-9_real64, stat=stat, msg=msg)
    call refused('a short column', 105, 'pressure has the size 2, expected 6')
    deallocate (bus%pressure)
    call bus%step(1e-9_real64, stat=stat, msg=msg)
    call refused('a missing column', 105, 'pressure_pa')
    allocate (bus%pressure(n), source=1e8_real64)
    call bus%step(1e-9_real64, mask=[.true.], stat=stat, msg=msg)
    call refused('a short mask', 105, 'mask has the size 1, expected 6')
    call bus%step(-1e-9_real64, stat=stat, msg=msg)
    call refused('a negative dt', 301, 'dt')
    allocate (bus%soft_shear_rate(n), source=0.0_real64)
    call bus%step(1e-9_real64, stat=stat, msg=msg)
    call refused('a column of the other strategy', 106, 'soft_shear_rate_per_s is no input')
    call bus%close()
    call bus%open(nodes=[1_int64], scene=scene, endpoint=endpoint)
    call bus%step(1e-9_real64, stat=stat, msg=msg)
    call refused('inputs that were never set', 301, 'nan')
    call bus%close()
  end subroutine

  ! Outcomes of nodes that sleep, as they are in whole and in masked steps, and 0 once they are solved again.
  subroutine asleep()
    type(shearbus_interface) :: bus
    character(len=:), allocatable :: text
    integer :: place, k
    text = scene_of('aluminium_dlp', 0.1_real64)
    place = index(text, '[interface]')
    call bus%open(nodes=[1, 2], scene_text=text(:place - 1)//'sleep = true'//new_line('a')//text(place:), endpoint=endpoint, &
                  check_closure='off')
    bus%jump = 0
    bus%pressure = -1
    bus%stress_soft = 0
    bus%stress_hard = 0
    bus%mass_soft = 2.7_real64
    bus%mass_hard = 7.9_real64
    do k = 1, 60
      call bus%step(1e-9_real64)
    end do
    call check('asleep', all(bus%outcome == shearbus_outcome_asleep) .and. bus%flagged == 0)
    call bus%step(1e-9_real64, mask=[.true., .true.])
    call check('asleep in a masked step', all(bus%outcome == shearbus_outcome_asleep))
    bus%jump = 50
    bus%pressure = 1e9_real64
    call bus%step(1e-9_real64)
    call check('awake', all(bus%outcome == 0))
    call bus%close()
  end subroutine

  ! Stick stress and impedance in place of stresses and masses: the same answers to rounding.
  subroutine stick_form()
    type(shearbus_interface) :: far_field, stick
    real(real64), parameter :: dt = 1e-9_real64
    real(real64) :: rate(n)
    call open_six(far_field, 600_int64)
    call open_six(stick, 700_int64)
    call far_field%step(dt)
    rate = dt*(1/stick%mass_soft + 1/stick%mass_hard)
    allocate (stick%impedance(n), source=1/rate)
    allocate (stick%stick_stress(n), source=stick%impedance*(stick%jump + &
              dt*(stick%stress_soft/stick%mass_soft + stick%stress_hard/stick%mass_hard)))
    deallocate (stick%stress_soft)
    call stick%step(dt, stat=stat, msg=msg)
    call ok('step in stick form')
    deallocate (stick%impedance)
    call stick%step(dt, stat=stat, msg=msg)
    call refused('a stick stress without impedance', 105, 'impedance_pa_s_per_m')
    call check('stick form', all(abs(stick%stress - far_field%stress) <= 1e-9_real64*abs(far_field%stress)) .and. &
               all(abs(stick%temperature - far_field%temperature) < 1e-6_real64))
    call far_field%close()
    call stick%close()
    call far_field%open(nodes=[1], scene=scene, endpoint=endpoint, check_closure='error')
    far_field%jump = [90.0_real64]
    far_field%pressure = [2e8_real64]
    far_field%stress_soft = [0.0_real64]
    far_field%stress_hard = [0.0_real64]
    far_field%mass_soft = [4e-3_real64]
    far_field%mass_hard = [12e-3_real64]
    call far_field%step(dt)
    call far_field%step(dt, stat=stat, msg=msg)
    call refused('an answer that is not applied', 504, 'NOT_CLOSED')
    call refused('the remedy in words of Fortran', 504, "check_closure = 'warn'")
    call far_field%close()
  end subroutine

  ! The ledger and other columns on request, and profiles.
  subroutine further_columns(bus)
    type(shearbus_interface), intent(inout) :: bus
    type(shearbus_profiles) :: layers
    real(real64) :: committed(n)
    integer :: interface_at(1)
    committed = bus%temperature
    call bus%want([character(20) :: 'ledger', 'stress_per_jump', 'time_to_melting'], stat, msg)
    call ok('want')
    call check('columns of the ledger', allocated(bus%interface_work) .and. allocated(bus%energy_residual))
    call bus%step(1e-9_real64, 3e-9_real64, 3, trial=.true., stat=stat, msg=msg)
    call ok('step with the ledger')
    call check('work', all(bus%interface_work > 0))
    call check('heat', all(bus%heat_to_soft > 0) .and. &
               all(abs(bus%heat_to_soft + bus%heat_to_hard - bus%interface_work) <= 1e-9_real64*bus%interface_work))
    call check('linearised answer', all(bus%stress_per_jump >= 0) .and. all(bus%time_to_melting > 0))
    call bus%rollback(stat, msg)
    call ok('rollback')
    deallocate (bus%interface_work, bus%heat_to_soft, bus%heat_to_hard, bus%plastic_work, bus%stored_heat_soft, &
                bus%stored_heat_hard, bus%elastic_energy, bus%heat_residual, bus%energy_residual, bus%stress_per_jump, &
                bus%time_to_melting)
    call bus%want(['stess'], stat, msg)
    call refused('a column that no step has', shearbus_code_shape, 'stess')
    call bus%profiles(bus%nodes(:2), layers, stat=stat, msg=msg)
    call ok('profiles')
    call check('shape of profiles', layers%nodes == 2 .and. layers%vertices > 2 .and. &
               all(shape(layers%layer_temperature) == [layers%vertices, 2]))
    interface_at = minloc(abs(layers%position(:, 1)))
    call check('profiles', all(layers%layer_temperature >= 300) .and. .not. allocated(layers%layer_shear_stress2) .and. &
               abs(layers%layer_temperature(interface_at(1), 1) - committed(1)) < 1e-9_real64)
    call bus%profiles([1], layers, stat=stat, msg=msg)
    call refused('profiles of a node that the session lacks', shearbus_code_unknown_node, '')
  end subroutine

  subroutine moves()
    type(shearbus_interface) :: giver, taker, alone
    character(len=shearbus_ticket_length) :: ticket
    character(len=shearbus_transfer_length) :: transfer
    call open_six(alone, 300_int64)
    call alone%step(1e-9_real64)
    call alone%step(1e-9_real64)
    call open_six(giver, 300_int64, 'fortran_library')
    call open_six(taker, 900_int64, 'fortran_library')
    call giver%step(1e-9_real64)
    ticket = giver%ticket()
    call giver%leave()
    call giver%resume('not a ticket', endpoint=endpoint, stat=stat, msg=msg)
    call refused('no ticket', 301, 'ticket')
    call giver%resume(ticket, endpoint=endpoint, stat=stat, msg=msg)
    call ok('resume')
    call check('nodes of a resumed session', all(giver%nodes == alone%nodes))
    call giver%offer([307, 328], transfer, stat, msg)
    call ok('offer')
    call check('four stay', giver%n == 4 .and. size(giver%pressure) == 4)
    call taker%accept('xyz', stat, msg)
    call refused('no transfer', 105, 'transfer')
    call taker%accept(transfer, stat, msg)
    call ok('accept')
    call check('eight nodes', taker%n == 8 .and. taker%nodes(7) == 307 .and. taker%nodes(8) == 328)
    call check('columns follow their nodes', taker%jump(6) == 96 .and. size(taker%regime) == 8)
    taker%jump(7:8) = alone%jump([1, 4])
    taker%pressure(7:8) = alone%pressure([1, 4])
    taker%stress_soft(7:8) = alone%stress_soft([1, 4])
    taker%stress_hard(7:8) = alone%stress_hard([1, 4])
    taker%mass_soft(7:8) = alone%mass_soft([1, 4])
    taker%mass_hard(7:8) = alone%mass_hard([1, 4])
    call taker%step(1e-9_real64, stat=stat, msg=msg)
    call ok('step of moved nodes')
    call check('the same answer in another session', all(taker%temperature(7:8) == alone%temperature([1, 4])))
    call taker%retire([907, 914], stat, msg)
    call ok('retire')
    call taker%register([5_int64], initial_temperature=[310.0_real64], stat=stat, msg=msg)
    call ok('register')
    call check('seven nodes', taker%n == 7 .and. taker%nodes(7) == 5 .and. taker%jump(1) == 93)
    call giver%close()
    call taker%close()
    call alone%close()
  end subroutine

  ! A session whose variable goes out of scope stays open on the server.
  subroutine scopes()
    character(len=shearbus_ticket_length) :: ticket
    type(shearbus_interface) :: again
    call leave_scope(ticket)
    call again%resume(ticket, endpoint=endpoint, retry_after=-4.0_real64, stat=stat, msg=msg)
    call refused('the time of repetition of a resumption', 301, 'retry_after_s is -4')
    call again%resume(ticket, endpoint=endpoint, retry_after=0.5_real64, stat=stat, msg=msg)
    call ok('resume after the end of a scope')
    call again%close()
  end subroutine

  ! Nodes of two pairs and of three coefficients of friction: each answers as in a session of its own scene.
  subroutine pairs()
    character(len=*), parameter :: key = 'interface.friction_coefficient', nl = new_line('a')
    character(len=*), parameter :: named = nl//'[pair.copper.soft]'//nl//'material = "copper_ofhc"'
    character(len=6), parameter :: names(n) = [character(len=6) :: '', 'copper', 'copper', '', 'copper', '']
    real(real64), parameter :: mu(n) = [0.1_real64, 0.1_real64, 0.2_real64, 0.2_real64, 0.2_real64, 0.05_real64]
    type(shearbus_interface) :: bus, own, other
    character(len=shearbus_ticket_length) :: ticket
    integer(int64) :: ids(n)
    ids = [(600_int64 + i, i=1, n)]
    call bus%open(nodes=ids(:4), scene_text=scene_of('aluminium_dlp', 0.1_real64)//named, endpoint=endpoint, &
                  pair=names(:4), parameters=[key], values=reshape(mu(:4), [4, 1]), check_closure='off', stat=stat, msg=msg)
    call ok('open with pairs and parameters')
    call bus%register(ids(5:), pair=names(5:), parameters=[key], values=reshape(mu(5:), [2, 1]), stat=stat, msg=msg)
    call ok('register with pairs and parameters')
    call fill(bus)
    call bus%step(1e-9_real64)
    do i = 1, n
      call own%open(nodes=[ids(i)], scene_text=scene_of(trim(merge('copper_ofhc  ', 'aluminium_dlp', names(i) /= '')), mu(i)), &
                    endpoint=endpoint, check_closure='off', stat=stat, msg=msg)
      call ok('open alone')
      own%jump = bus%jump(i:i); own%pressure = bus%pressure(i:i)
      own%stress_soft = bus%stress_soft(i:i); own%stress_hard = bus%stress_hard(i:i)
      own%mass_soft = bus%mass_soft(i:i); own%mass_hard = bus%mass_hard(i:i)
      call own%step(1e-9_real64)
      call check('the answer of its own scene', own%stress(1) == bus%stress(i) .and. own%temperature(1) == bus%temperature(i))
      call own%close()
    end do
    call bus%register([700], pair=['copper', 'copper'], stat=stat, msg=msg)
    call refused('two names for a node', 105, 'pair has the size 2, expected 1')
    call bus%register([700], parameters=[key], stat=stat, msg=msg)
    call refused('a key without values', 105, 'values, second dimension has the size 0, expected 1')
    call bus%register([700], parameters=[key], values=reshape([0.1_real64, 0.1_real64], [2, 1]), stat=stat, msg=msg)
    call refused('two values for a node', 105, 'values, first dimension has the size 2, expected 1')
    call check('refused nodes are not there', bus%n == n)
    ticket = bus%ticket()
    call bus%leave()
    call other%resume(ticket, endpoint=endpoint, nodes=int(ids), pair=names(n:1:-1), stat=stat, msg=msg)
    call refused('other pairs', 206, 'node 603 has the pair "copper" in the session, the host ""')
    call other%resume(ticket, endpoint=endpoint, nodes=ids, pair=names, parameters=[key], values=reshape(mu, [n, 1]), &
                      stat=stat, msg=msg)
    call ok('resume with the nodes as they are')
    call other%close()
  end subroutine

  function scene_of(soft, mu) result(text)
    character(len=*), intent(in) :: soft
    real(real64), intent(in) :: mu
    character(len=:), allocatable :: text
    character(len=*), parameter :: nl = new_line('a')
    character(len=8) :: number
    write (number, '(f8.3)') mu
    text = 'name = "of_its_own"'//nl//'strategy = "force_driven"'//nl//'[soft]'//nl//'material = "'//soft//'"'//nl//'[hard]'//nl// &
           'material = "steel_dlp"'//nl//'[layer]'//nl//'thickness_m = 20e-6'//nl//'cells = 40'//nl//'grading = 1.1'//nl// &
           'far_boundary = "half_space"'//nl//'[interface]'//nl//'friction_coefficient = '//trim(adjustl(number))//nl// &
           'yield_strength_pa = 10e9'
  end function

  subroutine leave_scope(ticket)
    character(len=*), intent(out) :: ticket
    type(shearbus_interface) :: bus
    call open_six(bus, 500_int64)
    ticket = bus%ticket()
  end subroutine
end program
