// shearbus-bench-mpi REQUEST_BYTES REPLY_BYTES ROUNDS, on two ranks, makes round trips by MPI_Send and MPI_Recv, the
// yardstick of tests/bench/run.py for those of the bus. Each rank writes every number that it sends and reads every
// number that it gets once. Rank 0 prints the median and the lowest tenth of the times as JSON.
#include <mpi.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <numeric>
#include <vector>

namespace {

void send(std::vector<double>& numbers, double value, int rank) {
  std::fill(numbers.begin(), numbers.end(), value);
  MPI_Send(numbers.data(), static_cast<int>(numbers.size()), MPI_DOUBLE, rank, 0, MPI_COMM_WORLD);
}

double receive(std::vector<double>& numbers, int rank) {
  MPI_Recv(numbers.data(), static_cast<int>(numbers.size()), MPI_DOUBLE, rank, 0, MPI_COMM_WORLD, MPI_STATUS_IGNORE);
  return std::accumulate(numbers.begin(), numbers.end(), 0.0);
}

}  // namespace

int main(int argc, char** argv) {
  MPI_Init(&argc, &argv);
  int rank = 0, ranks = 0;
  MPI_Comm_rank(MPI_COMM_WORLD, &rank);
  MPI_Comm_size(MPI_COMM_WORLD, &ranks);
  if (argc != 4 || ranks != 2) {
    std::fprintf(stderr, "usage: mpirun -n 2 shearbus-bench-mpi REQUEST_BYTES REPLY_BYTES ROUNDS\n");
    MPI_Abort(MPI_COMM_WORLD, 2);
  }
  std::vector<double> request(std::strtoul(argv[1], nullptr, 10) / sizeof(double));
  std::vector<double> reply(std::strtoul(argv[2], nullptr, 10) / sizeof(double));
  const int rounds = std::atoi(argv[3]);
  std::vector<double> us;
  double sum = 1.0;
  for (int round = 0; round < rounds; ++round) {
    if (rank == 0) {
      const auto started = std::chrono::steady_clock::now();
      send(request, 1.0 / (1.0 + std::abs(sum)), 1);
      sum = receive(reply, 1);
      us.push_back(std::chrono::duration<double, std::micro>(std::chrono::steady_clock::now() - started).count());
    } else {
      sum = receive(request, 0);
      send(reply, sum, 0);
    }
  }
  if (rank == 0) {
    std::sort(us.begin(), us.end());
    std::printf("{\"median_us\": %.3f, \"lowest_tenth_us\": %.3f}\n", us[us.size() / 2], us[us.size() / 10]);
  }
  MPI_Finalize();
  return 0;
}
