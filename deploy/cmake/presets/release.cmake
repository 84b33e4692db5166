# What deploy/run and deploy/test build: optimised, several files of a room at once.
set(CMAKE_BUILD_TYPE Release CACHE STRING "")
set(SHEARBUS_UNITY ON CACHE BOOL "")
