# Completion of the programs of shearbus for bash, from what their --help says.
_shearbus() {
  local cur prev words cword split
  _init_completion -s || return
  local program=${words[0]} command=
  if [[ ${program##*/} == shearbus-ctl ]]; then
    local commands
    commands=$("$program" --help 2>/dev/null | sed -n '/^Subcommands:/,$ s/^  \([a-z]\+\) .*/\1/p')
    if ((cword == 1)) && [[ $cur != -* ]]; then
      mapfile -t COMPREPLY < <(compgen -W "$commands" -- "$cur")
      return
    fi
    command=${words[1]}
  fi
  if [[ $cur == -* ]]; then
    # shellcheck disable=SC2086  # no command, no word
    mapfile -t COMPREPLY < <(compgen -W "$("$program" $command --help 2>/dev/null | grep -oE '(^|[ ,])--[a-z][a-z-]+' | tr -d ' ,')" -- "$cur")
  else
    _filedir
  fi
}
complete -F _shearbus shearbus-server shearbus-ctl shearbus-replay shearbus-report
