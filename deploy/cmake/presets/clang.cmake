# A second compiler on everything, with the standard library of the first.
set(CMAKE_C_COMPILER clang-14 CACHE STRING "")
set(CMAKE_CXX_COMPILER clang++-14 CACHE STRING "")
set(CMAKE_BUILD_TYPE RelWithDebInfo CACHE STRING "")
set(SHEARBUS_WARNINGS_AS_ERRORS ON CACHE BOOL "")
set(SHEARBUS_UNITY ON CACHE BOOL "")
