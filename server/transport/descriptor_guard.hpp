// Bounds what peers can occupy before they are admitted: file descriptors, and memory for their bytes.
//
// libzmq 4.3.4 has no limit of its own for either. If accept() finds no free descriptor, its ipc listener aborts the
// process (the assertion in ipc_listener.cpp lacks EMFILE, in later versions, too); and the largest size of a message,
// 32 MiB, holds before the handshake as well. Nothing that libzmq offers runs between one accept() and the next: when
// an event of its monitor is read, the flood is over. Therefore descriptor_guard.cpp defines accept4(), recv() and
// send() in front of those of the C library. They do what they always do, except for sockets accepted after begin():
//
// - A connection whose descriptor would be one of the last fifth is closed at once. Files of the server need the fifth.
// - A connection that is not admitted yet may send kBytesBeforeAdmission. If it sends more, it is closed. libzmq sends
//   the command READY of ZMTP 3 to a peer when it has admitted the peer.
// - A connection that is still not admitted after kUnadmittedConnections later ones is closed.
//
// A library loaded with dlopen cannot replace functions of the C library; a server in such a library listens to its own
// process only.
#pragma once

#include <cstddef>
#include <cstdint>

namespace shearbus::transport {

inline constexpr std::size_t kUnadmittedConnections = 1024;
inline constexpr std::size_t kBytesBeforeAdmission = std::size_t{16} << 10;  // a handshake needs less than 2 kB

struct GuardCounters {
  std::uint64_t out_of_descriptors = 0;  // number of connections closed to keep descriptors free
  std::uint64_t too_many_bytes = 0;      // number of connections closed because they sent too much before admission
  std::uint64_t displaced = 0;           // number of connections closed because later ones needed their place
};

// Guards the sockets that this process accepts from now on. Later calls change nothing.
void begin_descriptor_guard();

GuardCounters descriptor_guard_counters();

// Ends a connection that was accepted since begin(): libzmq finds the end of its stream, and closes it. Returns false if
// the descriptor is another file by now.
bool end_connection(int file);

}  // namespace shearbus::transport
