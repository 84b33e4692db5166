// The MPI helpers of the C++ interface, for C++17 and later: a class over shearbus_mpi.h, which says what each call
// does. The host compiles client/mpi/shearbus_mpi.c (installed in share/shearbus) with its own MPI; the CMake target is
// shearbus::mpi.
//
//   shearbus::Ranks ranks(MPI_COMM_WORLD);
//   shearbus::Session bus = ranks.open(options, node_ids);
//   ranks.together([&] { bus.step(step); });                 // throws on all ranks if one rank was refused
//   ranks.redistribute(bus, new_owner);
//   ranks.dump(bus, "dump_0042", "dump_0042.tickets");
//   ranks.close(bus);
//
// Every member function except rank() and domain() is collective, and throws the same shearbus::Error on all ranks.
#pragma once

#include <shearbus/shearbus_mpi.h>

#include <shearbus/client.hpp>
#include <utility>
#include <vector>

namespace shearbus {
inline namespace v1 {

class Ranks {
 public:
  explicit Ranks(MPI_Comm comm) : comm_(comm) {}
  Ranks(Ranks&& other) noexcept : comm_(other.comm_), handle_(std::exchange(other.handle_, nullptr)) {}
  Ranks& operator=(Ranks&& other) noexcept {
    std::swap(comm_, other.comm_);
    std::swap(handle_, other.handle_);
    return *this;
  }
  // Leaves the sessions on the server. It is not collective, so an exception may pass it on one rank alone.
  ~Ranks() { shearbus_mpi_leave(&handle_, nullptr); }

  Session open(const Options& options, const Ids& node_ids, const std::vector<double>& initial_temperature_k = {}) {
    return open_by(shearbus_mpi_open, options, node_ids, initial_temperature_k);
  }
  Session restart(const Options& options, const std::string& manifest, const Ids& node_ids) {
    return by(options, [&](shearbus_session** handle, const shearbus_options* given, shearbus_status* status) {
      return shearbus_mpi_restart(&handle_, comm_, handle, given, manifest.c_str(), node_ids.size(), node_ids.data(),
                                  status);
    });
  }
  // Opens one session, on rank 0, with the nodes of all ranks; the other ranks get an empty Session.
  Session open_on_root(const Options& options, const Ids& node_ids,
                       const std::vector<double>& initial_temperature_k = {}) {
    return open_by(shearbus_mpi_open_on_root, options, node_ids, initial_temperature_k);
  }
  shearbus_result step_on_root(Session& session, const Step& step, int mode = SHEARBUS_ADVANCE) {
    const shearbus_request request = step.request(mode);
    shearbus_result result = SHEARBUS_RESULT_INIT;
    call(shearbus_mpi_step_on_root, handle_, session.c_handle(), &request, &result);
    return result;
  }

  // Calls function() on every rank. If it throws shearbus::Error on one, this throws on all.
  template <typename Function>
  void together(const Function& function) {
    shearbus_status status = SHEARBUS_STATUS_INIT;
    try {
      function();
    } catch (const Error& fault) {
      status = fault.status();
    }
    if (shearbus_mpi_agree(handle_, status.code, &status) != SHEARBUS_OK) throw Error(status);
  }

  void redistribute(Session& session, const std::vector<int>& new_owner) {
    const std::size_t nodes = shearbus_node_count(session.c_handle());
    // A list of the wrong length is refused by all ranks, as any other fault of one rank.
    together([&] {
      if (new_owner.size() != nodes)
        throw Error::of(SHEARBUS_SHAPE, "new_owner",
                        "new_owner has " + std::to_string(new_owner.size()) + " ranks, and the session has " +
                            std::to_string(nodes) + " nodes");
    });
    call(shearbus_mpi_redistribute, handle_, session.c_handle(), new_owner.data());
  }
  void dump(Session& session, const std::string& mark, const std::string& manifest) {
    call(shearbus_mpi_dump, handle_, session.c_handle(), mark.c_str(), manifest.c_str());
  }
  void close(Session& session) {
    together([&] { session.close(); });
    call(shearbus_mpi_close, &handle_, static_cast<shearbus_session**>(nullptr));
  }

  int rank() const noexcept { return shearbus_mpi_rank(handle_); }
  std::string domain() const { return shearbus_mpi_domain(handle_); }

 private:
  template <typename Opening>
  Session by(const Options& options, const Opening& opening) {
    try {
      return Session::open_by(options, opening);
    } catch (...) {
      shearbus_mpi_leave(&handle_, nullptr);  // Session keeps no handle with which the opening could be repeated
      throw;
    }
  }
  template <typename Function>
  Session open_by(Function function, const Options& options, const Ids& ids, const std::vector<double>& temperatures) {
    const int is_wrong = !temperatures.empty() && temperatures.size() != ids.size();
    int any_is_wrong = 0;
    MPI_Allreduce(&is_wrong, &any_is_wrong, 1, MPI_INT, MPI_MAX, comm_);
    if (any_is_wrong != 0)
      throw std::invalid_argument("initial_temperature_k: give one value per node, or none, on every rank");
    return by(options, [&](shearbus_session** handle, const shearbus_options* given, shearbus_status* status) {
      return function(&handle_, comm_, handle, given, ids.size(), ids.data(),
                      temperatures.empty() ? nullptr : temperatures.data(), status);
    });
  }

  MPI_Comm comm_;
  shearbus_mpi* handle_ = nullptr;
};

}  // namespace v1
}  // namespace shearbus
