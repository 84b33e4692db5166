# Run at each build (server/CMakeLists.txt): writes the commit of the sources to FILE, a C++ source, unless FILE has it already. So a new commit
# compiles one small file and links the programs again.
#   cmake -DSOURCE=DIR -DFILE=commit.cpp -P commit.cmake
cmake_minimum_required(VERSION 3.25)
set(commit "")
find_program(git git)
if(git AND EXISTS ${SOURCE}/.git)
  execute_process(COMMAND ${git} -C ${SOURCE} rev-parse --short=12 HEAD OUTPUT_VARIABLE commit OUTPUT_STRIP_TRAILING_WHITESPACE ERROR_QUIET)
  execute_process(COMMAND ${git} -C ${SOURCE} --no-optional-locks status --porcelain --untracked-files=no OUTPUT_VARIABLE changes ERROR_QUIET)
  if(commit AND changes)
    string(APPEND commit "+dirty")
  endif()
endif()
if(NOT commit)
  set(commit unknown)
endif()
file(CONFIGURE OUTPUT ${FILE} CONTENT "#include \"server/version.hpp\"\n\nnamespace shearbus::server {\nconst char* const kCommit = \"@commit@\";\n}\n" @ONLY)
