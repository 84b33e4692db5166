// The memory per node that a server reports (SessionOpened.bytes_per_node) must be the memory that it uses, measured as
// resident memory of this process.
#include <gtest/gtest.h>
#include <malloc.h>
#include <unistd.h>

#include <fstream>

#include "server/service/scene_model.hpp"
#include "tests/support/service_harness.hpp"

#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
constexpr bool kHasItsOwnMemory = true;  // true under a sanitizer, which adds shadow memory and a quarantine
#else
constexpr bool kHasItsOwnMemory = false;
#endif

namespace shearbus::service {
namespace {

constexpr std::size_t kNodes = 100'000;
constexpr double kFactor = 1.10;

// Resident memory of this process [bytes], after freed memory has been returned to the system.
double resident_bytes() {
  ::malloc_trim(0);
  std::ifstream statm("/proc/self/statm");
  std::uint64_t total = 0, resident = 0;
  statm >> total >> resident;
  return static_cast<double>(resident) * static_cast<double>(::sysconf(_SC_PAGESIZE));
}

struct Case {
  const char* name;
  wire::Strategy strategy;
  bool friction_energy = false;
};
class Memory : public testing::TestWithParam<Case> {};
INSTANTIATE_TEST_SUITE_P(Scenes, Memory,
                         testing::Values(Case{"VelocityDriven", wire::Strategy::kVelocityDriven},
                                         Case{"ForceDriven", wire::Strategy::kForceDriven},
                                         Case{"ForceDrivenWithSums", wire::Strategy::kForceDriven, true}),
                         [](const auto& given) { return given.param.name; });

TEST_P(Memory, ANodeCostsWhatTheOpeningSays) {
  if (kHasItsOwnMemory) GTEST_SKIP() << "under a sanitizer memory is its own";
  const auto ids = support::node_ids(kNodes);
  const wire::Strategy strategy = GetParam().strategy;
  v1::Scene scene = support::scene_of(strategy);
  scene.set_friction_energy(GetParam().friction_energy);
  ServiceHarness harness;
  // Not measured: a first session, in which the server allocates what it needs only once.
  harness.ask(ServiceHarness::opening(scene, std::span(ids).first(8), 9));
  harness.ask(
      ServiceHarness::step(1, support::step_columns(strategy, std::span(ids).first(8), 0), wire::Mode::kAdvance, 9));
  const double before = resident_bytes();
  const auto per_node = [&] { return (resident_bytes() - before) / kNodes; };

  const auto opened = harness.ask(ServiceHarness::opening(scene, ids));
  ASSERT_EQ(opened.code(), Code::kOk) << opened.reply.status.text;
  const auto stated = static_cast<double>(std::get<wire::SessionOpened>(opened.reply.body).bytes_per_node);
  for (std::uint64_t i = 1; i <= 2; ++i)  // two steps fill both state buffers and the stored reply
    ASSERT_EQ(harness.ask(ServiceHarness::step(i, support::step_columns(strategy, ids, static_cast<int>(i)))).code(),
              Code::kOk);
  const double measured = per_node();
  EXPECT_LT(measured, stated * kFactor);
  EXPECT_GT(measured, stated / kFactor);

  // Nodes that retire give their memory back, and nodes that register later take no more memory than the first nodes
  // took.
  const std::span some = std::span(ids).subspan(8);
  const auto change = [&](auto body, std::uint64_t sequence) {
    wire::Request request = ServiceHarness::in_session(std::move(body), sequence);
    request.batch = ServiceHarness::opening(scene, some).batch;
    return harness.ask(request).code();
  };
  ASSERT_EQ(change(wire::RetireNodes{}, 3), Code::kOk);
  const double left = per_node();
  EXPECT_LT(left, 0.1 * stated);
  ASSERT_EQ(change(wire::RegisterNodes{}, 4), Code::kOk);
  ASSERT_EQ(harness.ask(ServiceHarness::step(5, support::step_columns(strategy, ids, 5))).code(), Code::kOk);
  EXPECT_LT(per_node(), stated * kFactor);

  const physics::Model model(scene_model(scene).options);
  const shard::TileStates states(model, false, GetParam().friction_energy);
  const double of_mark = 8.0 * static_cast<double>(states.doubles) / physics::kLanes + 12.0;
  ASSERT_EQ(harness.ask(ServiceHarness::in_session(wire::Mark{"dump"}, 6)).code(), Code::kOk);
  const double with_mark = per_node();
  EXPECT_LT(with_mark, (stated + of_mark) * kFactor);
  EXPECT_GT(with_mark, (stated + of_mark) / kFactor);

  std::cout << "bytes per node: stated " << stated << ", measured " << measured
            << "; after retiring all but 8: " << left << "; with a mark stated " << stated + of_mark << ", measured "
            << with_mark << "\n";
}

}  // namespace
}  // namespace shearbus::service
