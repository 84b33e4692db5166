// The example host of host.cpp on MPI ranks. Nodes move between the ranks in mid-run, as in a code that rebalances its
// mesh. The run can continue from a dump on any number of ranks. All answers have the same bits as on one rank.
//
//   mpirun -n RANKS host_mpi SCENE.toml ENDPOINT [DUMP [LAST_STEP]]
//
// If the file DUMP exists, the host continues from it; otherwise it writes it after step 30, with DUMP.tickets for the
// states of the server. With LAST_STEP it ends there and leaves its sessions on the server, as if it had been killed.
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdio>
#include <exception>
#include <iostream>
#include <shearbus/shearbus_mpi.hpp>
#include <string>
#include <vector>

namespace {

constexpr int kNodes = 10, kZones = 80, kSteps = 60, kDumpAfter = 30;
constexpr double kDt = 1e-9, kJump = 100.0, kFriction = 0.1;
constexpr double kDensity[2] = {2703.0, 7900.0}, kModulus[2] = {27.6e9, 77e9}, kSign[2] = {1.0, -1.0};  // soft, hard

double impedance(int body) {
  return std::sqrt(kDensity[body] * kModulus[body]);
}
double half_mass(int body) {
  return 0.5 * kDt * impedance(body);
}

// A node of the interface with the two half-spaces above and below it: [0] is at the interface.
struct Node {
  std::uint64_t id;
  double pressure, mass[2], jump, stress, temperature;
  std::array<double, kZones + 1> v[2];
  std::array<double, kZones> s[2];

  explicit Node(std::uint64_t number = 0)
      : id(number), pressure(100e6 * static_cast<double>(1 + number)), mass{half_mass(0), half_mass(1)}, v{}, s{} {
    v[0].fill(kJump);
  }
  void advance(double dt) {
    for (int b = 0; b < 2; ++b) {
      const double dz = kDt * impedance(b) / kDensity[b];
      v[b][0] += kSign[b] * dt / mass[b] * (s[b][0] - stress);
      for (int i = 1; i < kZones; ++i) v[b][i] += kSign[b] * dt / (kDensity[b] * dz) * (s[b][i] - s[b][i - 1]);
      for (int i = 0; i < kZones; ++i) s[b][i] += kSign[b] * kDt * kModulus[b] / dz * (v[b][i + 1] - v[b][i]);
    }
  }
};

struct Host {
  int rank, size;
  std::vector<Node> nodes;  // in the order of the session

  int owner(std::uint64_t id, int move) const {
    return static_cast<int>((id + static_cast<std::uint64_t>(move)) % size);
  }

  // Moves the host's own data of nodes to their new ranks. `nodes` keeps the order of the session: first the nodes that
  // stayed, then those that came, by the rank they came from.
  void move(const std::vector<int>& new_owner) {
    std::vector<Node> stay, leave, come;
    std::vector<int> n_leave(size), n_come(size), leave_at(size), come_at(size);
    stay.reserve(kNodes);
    for (int r = 0; r < size; ++r) {
      leave_at[r] = static_cast<int>(leave.size());
      for (std::size_t i = 0; i < nodes.size(); ++i)
        if (new_owner[i] == r) (r == rank ? stay : leave).push_back(nodes[i]);
      n_leave[r] = static_cast<int>(leave.size()) - leave_at[r];
    }
    MPI_Alltoall(n_leave.data(), 1, MPI_INT, n_come.data(), 1, MPI_INT, MPI_COMM_WORLD);
    for (int r = 0, total = 0; r < size; come.resize(total += n_come[r++])) come_at[r] = total;
    MPI_Datatype node;
    MPI_Type_contiguous(sizeof(Node), MPI_BYTE, &node);
    MPI_Type_commit(&node);
    MPI_Alltoallv(leave.data(), n_leave.data(), leave_at.data(), node, come.data(), n_come.data(), come_at.data(), node,
                  MPI_COMM_WORLD);
    MPI_Type_free(&node);
    stay.insert(stay.end(), come.begin(), come.end());
    nodes.swap(stay);
  }

  // Writes or reads the host's own dump: one file for all ranks, in which the node with id i is record number i.
  void transfer(const char* path, bool write) {
    MPI_File file;
    if (MPI_File_open(MPI_COMM_WORLD, path, write ? MPI_MODE_CREATE | MPI_MODE_WRONLY : MPI_MODE_RDONLY, MPI_INFO_NULL,
                      &file) != MPI_SUCCESS)
      throw std::runtime_error(std::string("cannot open ") + path);
    for (Node& node : nodes) {
      const MPI_Offset at = static_cast<MPI_Offset>(node.id) * static_cast<MPI_Offset>(sizeof(Node));
      if (write)
        MPI_File_write_at(file, at, &node, sizeof node, MPI_BYTE, MPI_STATUS_IGNORE);
      else
        MPI_File_read_at(file, at, &node, sizeof node, MPI_BYTE, MPI_STATUS_IGNORE);
    }
    MPI_File_close(&file);
  }
};

double run(const shearbus::Options& options, const char* dump, int last_step) {
  Host host{};
  MPI_Comm_rank(MPI_COMM_WORLD, &host.rank);
  MPI_Comm_size(MPI_COMM_WORLD, &host.size);
  shearbus::Ids ids;
  host.nodes.reserve(kNodes);
  for (std::uint64_t id = 0; id < kNodes; ++id)
    if (host.owner(id, 0) == host.rank) ids.push_back(id);

  int resumes = 0;  // whether rank 0 has found the dump
  const std::string tickets = std::string(dump) + ".tickets";
  if (std::FILE* file = host.rank == 0 ? std::fopen(tickets.c_str(), "r") : nullptr) resumes = std::fclose(file) == 0;
  MPI_Bcast(&resumes, 1, MPI_INT, 0, MPI_COMM_WORLD);
  shearbus::Ranks ranks(MPI_COMM_WORLD);
  shearbus::Session bus = resumes != 0 ? ranks.restart(options, tickets, ids) : ranks.open(options, ids);
  for (const std::uint64_t id : bus.node_ids()) host.nodes.emplace_back(id);
  if (resumes != 0) host.transfer(dump, false);

  for (int t = resumes != 0 ? kDumpAfter : 0; t < last_step; ++t) {
    const double dt = t == 0 ? 0.5 * kDt : kDt;  // the first velocities are half a step after the start
    for (Node& node : host.nodes) node.jump = node.v[0][0] - node.v[1][0];
    Node* first = host.nodes.data();
    constexpr auto kStride = static_cast<std::ptrdiff_t>(sizeof(Node));
    shearbus::Step step(host.nodes.size());
    step.in_strided(SHEARBUS_VELOCITY_JUMP, &first->jump, kStride)
        .in_strided(SHEARBUS_PRESSURE, &first->pressure, kStride)
        .in_strided(SHEARBUS_STRESS_SOFT, first->s[0].data(), kStride)
        .in_strided(SHEARBUS_STRESS_HARD, first->s[1].data(), kStride)
        .in_strided(SHEARBUS_MASS_SOFT, &first->mass[0], kStride)
        .in_strided(SHEARBUS_MASS_HARD, &first->mass[1], kStride)
        .out_strided(SHEARBUS_SHEAR_STRESS, &first->stress, kStride)
        .out_strided(SHEARBUS_INTERFACE_TEMPERATURE, &first->temperature, kStride);
    ranks.together([&] { bus.step(step.dt(dt)); });  // if one rank is refused, all throw
    for (Node& node : host.nodes) node.advance(dt);
    if (t % 10 == 4) {
      std::vector<int> new_owner;
      for (const Node& node : host.nodes) new_owner.push_back(host.owner(node.id, t));
      ranks.redistribute(bus, new_owner);
      host.move(new_owner);
    }
    if (t + 1 == kDumpAfter && *dump != '\0') {
      host.transfer(dump, true);
      ranks.dump(bus, "step_30", tickets);
    }
  }
  if (last_step < kSteps) return 0.0;
  ranks.close(bus);

  std::array<double, std::size_t{2} * kNodes> mine{}, all{};
  for (const Node& node : host.nodes) {
    mine[2 * node.id] = node.v[0][0] - node.v[1][0];
    mine[2 * node.id + 1] = node.temperature;
  }
  MPI_Allreduce(mine.data(), all.data(), 2 * kNodes, MPI_DOUBLE, MPI_SUM, MPI_COMM_WORLD);
  double worst = 0.0;
  for (std::size_t n = 0; n < kNodes; ++n) {
    const double pressure = 100e6 * static_cast<double>(1 + n);
    const double exact = kJump - kFriction * pressure * (1.0 / impedance(0) + 1.0 / impedance(1));
    worst = std::fmax(worst, std::fabs(all[2 * n] - exact));
    if (host.rank == 0)
      std::printf("node %2zu  P %5.0f MPa  [V] %.6f m/s  exact %.6f  T0 %.12g K\n", n + 1, pressure / 1e6, all[2 * n],
                  exact, all[2 * n + 1]);
  }
  return worst;
}

}  // namespace

int main(int argc, char** argv) {
  MPI_Init(&argc, &argv);
  int code = 1;
  try {
    shearbus::Options options;
    options.scene_file = argc > 1 ? argv[1] : "constant_friction.toml";
    options.endpoint = argc > 2 ? argv[2] : "";
    code = run(options, argc > 3 ? argv[3] : "", argc > 4 ? std::stoi(argv[4]) : kSteps) < 1e-6 ? 0 : 1;
  } catch (const std::exception& fault) {
    std::cerr << fault.what() << '\n';
  }
  MPI_Finalize();
  return code;
}
