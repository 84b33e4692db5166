# For daily work: short builds after a change, debugger, warnings as errors.
set(CMAKE_BUILD_TYPE RelWithDebInfo CACHE STRING "")
set(SHEARBUS_WARNINGS_AS_ERRORS ON CACHE BOOL "")
