# One set of compiler settings for every room.
#   -ffp-contract=off     an answer must have the same bits on every machine and in every lane (server/physics/METHODS.md, "Arithmetic")
#   -fno-math-errno,
#   -fno-trapping-math    nobody reads errno or traps; without these GCC does not vectorise the lane loops
add_library(shearbus_settings INTERFACE)
target_compile_options(shearbus_settings INTERFACE
  -Wall -Wextra -Wpedantic -Wshadow -Wconversion -Wno-sign-conversion -Wno-missing-field-initializers -Wnon-virtual-dtor -Woverloaded-virtual
  -ffp-contract=off -fno-math-errno -fno-trapping-math
  $<$<BOOL:${SHEARBUS_WARNINGS_AS_ERRORS}>:-Werror>)
if(SHEARBUS_SANITIZE)
  target_compile_options(shearbus_settings INTERFACE -fsanitize=${SHEARBUS_SANITIZE} -fno-omit-frame-pointer
                                                     -fno-sanitize-recover=all)
  target_link_options(shearbus_settings INTERFACE -fsanitize=${SHEARBUS_SANITIZE})
endif()

# shearbus_room(name SOURCES ... [PUBLIC libs] [PRIVATE libs]): one room, one static library.
function(shearbus_room name)
  cmake_parse_arguments(ROOM "" "" "SOURCES;PUBLIC;PRIVATE" ${ARGN})
  add_library(${name} STATIC ${ROOM_SOURCES})
  target_include_directories(${name} PUBLIC ${PROJECT_SOURCE_DIR})
  target_link_libraries(${name} PUBLIC ${ROOM_PUBLIC} PRIVATE shearbus_settings ${ROOM_PRIVATE})
  # The rooms are parts of shared libraries, too. Hidden symbols keep calls between them as direct as in a program.
  set_target_properties(${name} PROPERTIES POSITION_INDEPENDENT_CODE ON CXX_VISIBILITY_PRESET hidden UNITY_BUILD ${SHEARBUS_UNITY})
endfunction()

# shearbus_library(name SOURCES ... LINK ...): one shared library in build/lib for hosts of any language. It exports
# the C functions shearbus_* and nothing else.
function(shearbus_library name)
  cmake_parse_arguments(LIB "" "" "SOURCES;LINK" ${ARGN})
  add_library(${name} SHARED ${LIB_SOURCES})
  target_include_directories(${name} PRIVATE ${PROJECT_SOURCE_DIR})
  target_link_libraries(${name} PRIVATE shearbus_settings ${LIB_LINK})
  target_link_options(${name} PRIVATE -Wl,--version-script=${PROJECT_SOURCE_DIR}/deploy/cmake/exported_symbols.map -Wl,--as-needed)
  if(NOT SHEARBUS_SANITIZE)  # the sanitizers' functions come from the program
    target_link_options(${name} PRIVATE -Wl,-z,defs)
  endif()
  set_target_properties(${name} PROPERTIES CXX_VISIBILITY_PRESET hidden SOVERSION 1 VERSION 1.0.0 LIBRARY_OUTPUT_DIRECTORY ${PROJECT_BINARY_DIR}/lib
                                           LINK_DEPENDS ${PROJECT_SOURCE_DIR}/deploy/cmake/exported_symbols.map)
endfunction()

# shearbus_program(name SOURCES ... LINK ...): one executable in build/bin.
function(shearbus_program name)
  cmake_parse_arguments(PROGRAM "" "" "SOURCES;LINK" ${ARGN})
  add_executable(${name} ${PROGRAM_SOURCES})
  target_include_directories(${name} PRIVATE ${PROJECT_SOURCE_DIR})
  target_link_libraries(${name} PRIVATE shearbus_settings ${PROGRAM_LINK})
  # The parsers of command lines take a minute to compile at -O3.
  list(FILTER PROGRAM_SOURCES INCLUDE REGEX "(^|/)(main|options)\\.cpp$")
  if(PROGRAM_SOURCES AND CMAKE_BUILD_TYPE STREQUAL "Release")
    set_source_files_properties(${PROGRAM_SOURCES} PROPERTIES COMPILE_OPTIONS -O1)
  endif()
endfunction()
