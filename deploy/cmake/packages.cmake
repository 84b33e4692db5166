# Debian packages, one for each component of the installation: cmake --build BUILD --target packages
set(CMAKE_SKIP_INSTALL_ALL_DEPENDENCY ON)  # tests are no part of a package
find_program(SHEARBUS_HELP2MAN help2man)
find_program(SHEARBUS_GZIP gzip)
set(programs shearbus-server shearbus-ctl shearbus-replay)
set(manual)
if(SHEARBUS_HELP2MAN AND SHEARBUS_GZIP)
  set(shearbus-server_name "subgrid friction server for hydrocodes")
  set(shearbus-ctl_name "operate a shearbus server, check scenes, make keys")
  set(shearbus-replay_name "replay interface histories through the subgrid model")
  set(shearbus-report_name "put runs of shearbus into one HTML page")
  foreach(program ${programs} shearbus-report)
    set(file ${CMAKE_RUNTIME_OUTPUT_DIRECTORY}/${program})
    set(page ${CMAKE_CURRENT_BINARY_DIR}/man/${program}.1.gz)
    add_custom_command(OUTPUT ${page} DEPENDS $<IF:$<TARGET_EXISTS:${program}>,${program},${file}> VERBATIM
      COMMAND ${CMAKE_COMMAND} -E make_directory ${CMAKE_CURRENT_BINARY_DIR}/man
      COMMAND sh -c "\"$1\" --no-info --name=\"$2\" \"$3\" | \"$4\" -9n > \"$5\"" sh ${SHEARBUS_HELP2MAN} ${${program}_name} ${file}
              ${SHEARBUS_GZIP} ${page})
    list(APPEND manual ${page})
  endforeach()
  add_custom_target(manual ALL DEPENDS ${manual})
  install(FILES ${manual} DESTINATION ${CMAKE_INSTALL_MANDIR}/man1 COMPONENT server OPTIONAL)
endif()

set(packaging ${PROJECT_SOURCE_DIR}/deploy/packaging)
foreach(program ${programs} shearbus-report)
  install(FILES ${packaging}/completion.bash DESTINATION ${CMAKE_INSTALL_DATADIR}/bash-completion/completions RENAME ${program} COMPONENT server)
endforeach()
install(FILES deploy/systemd/shearbus-server.service DESTINATION lib/systemd/system COMPONENT server)

set(CPACK_GENERATOR DEB)
set(CPACK_PACKAGE_CONTACT "The maintainers of shearbus <maintainers@shearbus.invalid>")
set(CPACK_PACKAGE_DESCRIPTION_SUMMARY "")  # each package has its own
set(CPACK_PACKAGE_DIRECTORY ${CMAKE_BINARY_DIR}/packages)
set(CPACK_PACKAGING_INSTALL_PREFIX /usr)
set(CPACK_STRIP_FILES ON)
set(CPACK_COMPONENTS_ALL server runtime development python doc)
set(CPACK_DEB_COMPONENT_INSTALL ON)
set(CPACK_DEBIAN_FILE_NAME DEB-DEFAULT)
set(CPACK_DEBIAN_PACKAGE_CONTROL_STRICT_PERMISSION ON)
set(CPACK_DEBIAN_PACKAGE_SECTION science)

set(CPACK_DEBIAN_SERVER_PACKAGE_NAME shearbus-server)
set(CPACK_DEBIAN_SERVER_PACKAGE_SHLIBDEPS ON)
set(CPACK_DEBIAN_SERVER_PACKAGE_DEPENDS "adduser, python3:any")
set(CPACK_DEBIAN_SERVER_PACKAGE_RECOMMENDS "python3-shearbus, python3-matplotlib, python3-h5py, python3-jinja2")
set(CPACK_DEBIAN_SERVER_PACKAGE_SUGGESTS "shearbus-doc, python3-scipy")
set(CPACK_DEBIAN_SERVER_PACKAGE_CONTROL_EXTRA "${packaging}/server/postinst;${packaging}/server/prerm;${packaging}/server/postrm")
set(CPACK_DEBIAN_SERVER_DESCRIPTION "subgrid friction server for hydrocodes
The server keeps a shear layer of a few micrometres for each node of a sliding
interface and answers the macroscopic steps of hydrocodes over ZeroMQ. This
package has the server, the tools that operate it and replay histories, and
job scripts for Slurm.")

set(CPACK_DEBIAN_RUNTIME_PACKAGE_NAME libshearbus1)
set(CPACK_DEBIAN_RUNTIME_PACKAGE_SECTION libs)
set(CPACK_DEBIAN_RUNTIME_PACKAGE_SHLIBDEPS ON)
set(CPACK_DEBIAN_RUNTIME_PACKAGE_CONTROL_EXTRA "${packaging}/runtime/symbols;${packaging}/runtime/shlibs;${packaging}/runtime/triggers")
install(FILES ${packaging}/runtime/lintian-overrides DESTINATION ${CMAKE_INSTALL_DATADIR}/lintian/overrides RENAME libshearbus1 COMPONENT runtime)
set(CPACK_DEBIAN_RUNTIME_DESCRIPTION "client library of the shearbus friction server
Hosts in C, C++ and Fortran open sessions of a shearbus server with this
library, or run the server in their own process.")

set(CPACK_DEBIAN_DEVELOPMENT_PACKAGE_NAME libshearbus-dev)
set(CPACK_DEBIAN_DEVELOPMENT_PACKAGE_SECTION libdevel)
set(CPACK_DEBIAN_DEVELOPMENT_PACKAGE_DEPENDS "libshearbus1 (= ${PROJECT_VERSION})")
set(CPACK_DEBIAN_DEVELOPMENT_DESCRIPTION "headers and sources for hosts of the shearbus friction server
Headers for C and C++, sources for Fortran and MPI, which each host compiles
with its own compiler, and the files that CMake and pkg-config look for.")

set(CPACK_DEBIAN_PYTHON_PACKAGE_NAME python3-shearbus)
set(CPACK_DEBIAN_PYTHON_PACKAGE_SECTION python)
set(CPACK_DEBIAN_PYTHON_PACKAGE_ARCHITECTURE all)
set(CPACK_DEBIAN_PYTHON_PACKAGE_DEPENDS "python3:any (>= 3.11), python3-numpy, libshearbus1 (= ${PROJECT_VERSION})")
set(CPACK_DEBIAN_PYTHON_PACKAGE_RECOMMENDS "python3-zmq, python3-xxhash | libxxhash0")
set(CPACK_DEBIAN_PYTHON_PACKAGE_SUGGESTS shearbus-server)
set(CPACK_DEBIAN_PYTHON_DESCRIPTION "Python client of the shearbus friction server
Hosts in Python open sessions of a shearbus server with this package. It also
has the kit that holds clients in other languages to the protocol.")

set(CPACK_DEBIAN_DOC_PACKAGE_NAME shearbus-doc)
set(CPACK_DEBIAN_DOC_PACKAGE_SECTION doc)
set(CPACK_DEBIAN_DOC_PACKAGE_ARCHITECTURE all)
set(CPACK_DEBIAN_DOC_DESCRIPTION "documentation of the shearbus friction server
The guide for authors of hosts with examples, the protocol, the equations of
the subgrid model and how the server is run.")

# Every package has its copyright file and its changelog.
set(changelog ${CMAKE_CURRENT_BINARY_DIR}/changelog.gz)
if(SHEARBUS_GZIP)
  execute_process(COMMAND ${SHEARBUS_GZIP} -9nc ${packaging}/changelog OUTPUT_FILE ${changelog} COMMAND_ERROR_IS_FATAL ANY)
  foreach(component ${CPACK_COMPONENTS_ALL})
    string(TOUPPER ${component} COMPONENT)
    install(FILES ${packaging}/copyright ${changelog} COMPONENT ${component}
            DESTINATION ${CMAKE_INSTALL_DATADIR}/doc/${CPACK_DEBIAN_${COMPONENT}_PACKAGE_NAME})
  endforeach()
endif()
include(CPack)
add_custom_target(packages COMMAND ${CMAKE_CPACK_COMMAND} --config CPackConfig.cmake WORKING_DIRECTORY ${CMAKE_BINARY_DIR} USES_TERMINAL
                  DEPENDS ${manual} ${programs} shearbus_c shearbus_embedded_library shearbus_checkpoint_library)
