# ThreadSanitizer.
set(CMAKE_BUILD_TYPE RelWithDebInfo CACHE STRING "")
set(SHEARBUS_SANITIZE thread CACHE STRING "")
