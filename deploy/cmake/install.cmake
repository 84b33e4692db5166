# What `cmake --install` installs, by component: server, runtime (shared libraries), development, doc; python is in client/.
include(CMakePackageConfigHelpers)

# The interfaces for other languages are targets without a library of their own.
add_library(shearbus_cxx INTERFACE)
target_link_libraries(shearbus_cxx INTERFACE shearbus_c)
target_compile_features(shearbus_cxx INTERFACE cxx_std_17)
add_library(shearbus_fortran INTERFACE)
target_link_libraries(shearbus_fortran INTERFACE shearbus_c)
target_sources(shearbus_fortran INTERFACE $<BUILD_INTERFACE:${PROJECT_SOURCE_DIR}/client/fortran/shearbus.f90>
                                          $<INSTALL_INTERFACE:${CMAKE_INSTALL_DATADIR}/shearbus/shearbus.f90>)
# The MPI helpers are compiled with the MPI of each target that links them, since MPI has no common binary interface.
add_library(shearbus_mpi INTERFACE)
target_link_libraries(shearbus_mpi INTERFACE shearbus_c $<INSTALL_INTERFACE:MPI::MPI_C>)
target_sources(shearbus_mpi INTERFACE $<BUILD_INTERFACE:${PROJECT_SOURCE_DIR}/client/mpi/shearbus_mpi.c>
                                      $<INSTALL_INTERFACE:${CMAKE_INSTALL_DATADIR}/shearbus/shearbus_mpi.c>)
add_library(shearbus_mpi_fortran INTERFACE)
target_link_libraries(shearbus_mpi_fortran INTERFACE shearbus_mpi shearbus_fortran)
target_sources(shearbus_mpi_fortran INTERFACE $<BUILD_INTERFACE:${PROJECT_SOURCE_DIR}/client/mpi/shearbus_ranks.f90>
                                              $<INSTALL_INTERFACE:${CMAKE_INSTALL_DATADIR}/shearbus/shearbus_ranks.f90>)

set(interfaces c cxx fortran mpi mpi_fortran)
set(libraries ${interfaces})
if(TARGET shearbus_embedded_library)
  list(APPEND libraries embedded)
  set_target_properties(shearbus_embedded_library PROPERTIES EXPORT_NAME embedded)
  add_library(shearbus::embedded ALIAS shearbus_embedded_library)
endif()
foreach(library ${interfaces})
  set_target_properties(shearbus_${library} PROPERTIES EXPORT_NAME ${library})
  add_library(shearbus::${library} ALIAS shearbus_${library})
endforeach()
list(TRANSFORM libraries PREPEND shearbus_)
list(TRANSFORM libraries REPLACE "embedded$" embedded_library)
if(TARGET shearbus_checkpoint_library)  # no host links it
  install(TARGETS shearbus_checkpoint_library LIBRARY DESTINATION ${CMAKE_INSTALL_LIBDIR} COMPONENT runtime NAMELINK_SKIP)
endif()
install(TARGETS ${libraries} EXPORT shearbusTargets
        LIBRARY DESTINATION ${CMAKE_INSTALL_LIBDIR} COMPONENT runtime NAMELINK_COMPONENT development)

set(package ${CMAKE_INSTALL_LIBDIR}/cmake/shearbus)
install(EXPORT shearbusTargets NAMESPACE shearbus:: DESTINATION ${package} COMPONENT development)
configure_package_config_file(deploy/packaging/shearbusConfig.cmake.in shearbusConfig.cmake INSTALL_DESTINATION ${package})
write_basic_package_version_file(shearbusConfigVersion.cmake COMPATIBILITY SameMajorVersion)
install(FILES ${CMAKE_CURRENT_BINARY_DIR}/shearbusConfig.cmake ${CMAKE_CURRENT_BINARY_DIR}/shearbusConfigVersion.cmake
        DESTINATION ${package} COMPONENT development)

file(RELATIVE_PATH shearbus_prefix_from_pc /${CMAKE_INSTALL_LIBDIR}/pkgconfig /)
configure_file(deploy/packaging/shearbus.pc.in shearbus.pc @ONLY)
install(FILES ${CMAKE_CURRENT_BINARY_DIR}/shearbus.pc DESTINATION ${CMAKE_INSTALL_LIBDIR}/pkgconfig COMPONENT development)
install(DIRECTORY client/include/shearbus DESTINATION ${CMAKE_INSTALL_INCLUDEDIR} COMPONENT development)
install(FILES server/physics/interface/friction_law.h DESTINATION ${CMAKE_INSTALL_INCLUDEDIR}/shearbus COMPONENT development)
install(FILES client/fortran/shearbus.f90 client/fortran/shearbus_contract.inc client/mpi/shearbus_mpi.c client/mpi/shearbus_ranks.f90 DESTINATION ${CMAKE_INSTALL_DATADIR}/shearbus COMPONENT development)
install(FILES client/examples/constant_friction.toml client/examples/host.c client/examples/host.cpp client/examples/host.f90
              client/examples/host_mpi.cpp client/examples/host_mpi.f90 client/examples/friction_law.c
              client/examples/usrfrc.f90 client/examples/vendor_layers.f90 client/examples/vexternaldb.f90
              client/examples/vfric.f90 client/examples/vfriction.f90
        DESTINATION ${CMAKE_INSTALL_DATADIR}/shearbus/examples COMPONENT development)

# The pages, the examples, the scenes, and whatever else a page links, in the folders of the sources, so that the links hold.
file(GLOB_RECURSE pages RELATIVE ${PROJECT_SOURCE_DIR} .github/*.md client/*.md deploy/*.md hydro_stub/*.md proto/*.md server/*.md tests/*.md)
list(FILTER pages EXCLUDE REGEX ISSUE_TEMPLATE)
list(PREPEND pages README.md)
file(GLOB_RECURSE documents RELATIVE ${PROJECT_SOURCE_DIR} client/examples/* hydro_stub/problems/*.toml proto/shearbus/*.proto
     tests/contract/outsider.py)
foreach(page ${pages})
  get_filename_component(folder ${page} DIRECTORY)
  file(READ ${page} text)
  string(REPLACE "](" "@(" text "${text}")  # a bracket would join the elements of the list
  string(REGEX MATCHALL "@\\([^()#:; \n]+[#)]" links "${text}")
  list(TRANSFORM links REPLACE "[@()#]" "")
  foreach(link ${links})
    get_filename_component(target ${link} ABSOLUTE BASE_DIR ${PROJECT_SOURCE_DIR}/${folder})
    if(EXISTS ${target} AND NOT EXISTS ${target}/README.md)
      file(RELATIVE_PATH target ${PROJECT_SOURCE_DIR} ${target})
      list(APPEND documents ${target})
    endif()
  endforeach()
endforeach()
list(APPEND documents ${pages})
list(REMOVE_DUPLICATES documents)
foreach(document ${documents})
  get_filename_component(folder ${document} DIRECTORY)
  set(where DESTINATION ${CMAKE_INSTALL_DATADIR}/doc/shearbus/${folder} COMPONENT doc)
  if(IS_DIRECTORY ${PROJECT_SOURCE_DIR}/${document})
    install(DIRECTORY ${document} ${where})
  else()
    install(FILES ${document} ${where})
  endif()
endforeach()

install(FILES deploy/slurm/job.sh DESTINATION ${CMAKE_INSTALL_DATADIR}/shearbus/slurm COMPONENT server)
install(PROGRAMS deploy/slurm/one_node.sbatch deploy/slurm/several_nodes.sbatch deploy/slurm/mpi.sbatch
        DESTINATION ${CMAKE_INSTALL_DATADIR}/shearbus/slurm COMPONENT server)
foreach(program shearbus-server shearbus-ctl shearbus-replay)
  if(TARGET ${program})
    install(TARGETS ${program} RUNTIME DESTINATION ${CMAKE_INSTALL_BINDIR} COMPONENT server)
  endif()
endforeach()
