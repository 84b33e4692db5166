# Counters in every line. The threads of the pool and of OpenMP count the same lines, hence the atomic update.
set(CMAKE_BUILD_TYPE RelWithDebInfo CACHE STRING "")
set(CMAKE_C_FLAGS "--coverage -fprofile-update=atomic" CACHE STRING "")
set(CMAKE_CXX_FLAGS "--coverage -fprofile-update=atomic" CACHE STRING "")
set(SHEARBUS_UNITY ON CACHE BOOL "")
