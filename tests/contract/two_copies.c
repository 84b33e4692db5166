/* Two copies of the client library in one process, as two plugins of a host bring them: two_copies LIBRARY COPY SCENE.toml
 * ENDPOINT... Each opens a session at each endpoint while the other has its own open. */
#define _POSIX_C_SOURCE 200809L
#include <dlfcn.h>
#include <shearbus/shearbus.h>
#include <stdio.h>
#include <string.h>

typedef int (*open_fn)(shearbus_session**, const shearbus_options*, size_t, const uint64_t*, const double*,
                       shearbus_status*);
typedef int (*close_fn)(shearbus_session**, shearbus_status*);

int main(int argc, char** argv) {
  open_fn open[2];
  close_fn close[2];
  for (int copy = 0; copy < 2; ++copy) {
    void* library = dlopen(argv[1 + copy], RTLD_NOW | RTLD_LOCAL);
    if (library == NULL) return fprintf(stderr, "%s\n", dlerror()), 1;
    void* found[2] = {dlsym(library, "shearbus_open"), dlsym(library, "shearbus_close")};
    memcpy(&open[copy], &found[0], sizeof found[0]);
    memcpy(&close[copy], &found[1], sizeof found[1]);
  }
  if (open[0] == open[1]) return fprintf(stderr, "the two files are one library\n"), 1;
  for (int at = 4; at < argc; ++at) {
    shearbus_session* sessions[2] = {NULL, NULL};
    shearbus_status status = SHEARBUS_STATUS_INIT;
    shearbus_options options = SHEARBUS_OPTIONS_INIT;
    const uint64_t ids[2] = {1, 2};
    options.scene_file = argv[3];
    options.endpoint = argv[at];
    for (int copy = 0; copy < 2; ++copy)
      if (open[copy](&sessions[copy], &options, 2, ids, NULL, &status) != SHEARBUS_OK)
        return fprintf(stderr, "copy %d at %s: %s\n", copy, argv[at], status.text), 1;
    for (int copy = 0; copy < 2; ++copy)
      if (close[copy](&sessions[copy], &status) != SHEARBUS_OK) return fprintf(stderr, "%s\n", status.text), 1;
  }
  printf("two copies of the library live in one process\n");
  return 0;
}
