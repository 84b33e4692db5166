#include <xxhash.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <system_error>
#include <unordered_map>
#include <utility>

#include "proto/files/input_file.hpp"
#include "proto/files/recording.hpp"
#include "proto/files/recording_hdf5.hpp"
#include "proto/files/recording_storage.hpp"
#include "proto/files/recording_trial.hpp"
#include "proto/wire/limits.hpp"
#include "proto/wire/numbers.hpp"
#include "proto/wire/units.hpp"

namespace shearbus::files {
namespace {

namespace fs = std::filesystem;
using namespace hdf5;

constexpr std::size_t kMaxSteps = 100'000'000;
constexpr std::size_t kBufferElements = 131'072;  // 1 MiB of doubles
constexpr std::size_t kMaxChunkCacheBytes = 256ull << 20;
constexpr std::size_t kMaxTextWidth = 1 << 20;

const char* class_name(H5T_class_t type) {
  constexpr std::pair<H5T_class_t, const char*> kNames[] = {{H5T_INTEGER, "integer"},   {H5T_FLOAT, "float"},
                                                            {H5T_STRING, "text"},       {H5T_ENUM, "enum or bool"},
                                                            {H5T_COMPOUND, "compound"}, {H5T_ARRAY, "array"}};
  for (const auto& [known, name] : kNames)
    if (known == type) return name;
  return "non-numeric";
}

std::string shape_text(const Shape& shape) {
  std::string text = "[";
  for (std::size_t i = 0; i < shape.size(); ++i) text += fmt::format("{}{}", i ? ", " : "", shape[i]);
  return text + "]";
}

void convert(std::vector<double>& values, double to_si) {
  if (to_si == 1.0) return;
  for (double& value : values) value *= to_si;
}

}  // namespace

struct HistoryReader::Impl : Axes {
  // A [T,N] dataset (T steps, N nodes) and those of its rows that are in memory.
  struct Series {
    Dataset dataset;
    double to_si = 1.0;
    std::size_t rows_per_read = 1;
    std::size_t first = 0;
    std::size_t count = 0;
    std::vector<double> values;
  };

  fs::path file;
  File handle;
  std::unordered_map<std::string, Series> series;

  [[noreturn]] void fail(const std::string& name, const std::string& what, const std::string& remedy) const {
    refuse_file(file, fmt::format("/{}{}{}", name, what.starts_with('[') ? "" : " ", what), remedy, name);
  }

  template <typename Body>
  decltype(auto) reading(const Body& body) const {
    return in_file(file, "Is the file damaged?", body);
  }

  void open();
  bool has(std::string_view name) const { return hdf5::has_link(handle, std::string(name)); }
  Dataset open_dataset(const std::string& name, bool integers_only = false) const;
  Dataset open_values(const std::string& name) const;
  void check_link(const std::string& name) const;
  void check_storage(const std::string& name, hid_t dataset) const;
  double factor_to_si(const std::string& name, hid_t dataset) const;
  std::size_t length(const std::string& name, hid_t dataset, const char* letter, std::size_t most) const;
  void read_all(const std::string& name, hid_t dataset, hid_t memory_type, void* values) const;
  void read_start_time(hid_t time, double to_si);
  void read_times();
  void read_dts();
  void read_node_ids();
  Series& open_series(const std::string& name);
  void load_rows(const std::string& name, Series& one, std::size_t step) const;
  std::vector<std::string> read_texts(hid_t from) const;
  std::string read_text(hid_t from) const;
};

void HistoryReader::Impl::open() {
  std::error_code error;
  if (!fs::exists(file, error)) refuse_file(file, "no such file", "Give the path of an HDF5 history.");
  if (!fs::is_regular_file(file, error)) refuse_file(file, "is not a file", "Give the path of an HDF5 history.");
  if (fs::file_size(file, error) == 0)
    refuse_file(file, "is empty", "Expected an HDF5 history; was its writer interrupted?");
  if (H5Fis_hdf5(file.c_str()) <= 0) {
    const std::string why = reason();
    refuse_file(file, why.find("unable to open file") != std::string::npos ? "cannot be read" : "is not an HDF5 file",
                "Expected an HDF5 history; was it cut short or written in another format?");
  }
  if (!survives_its_texts(file))
    refuse_file(file, "is damaged: HDF5 does not survive its texts, such as attributes units",
                "Take a copy that is whole, or have the program that made it write it again.");
  const hid_t opened = H5Fopen(file.c_str(), H5F_ACC_RDONLY, H5P_DEFAULT);
  if (opened < 0)
    refuse_file(file, fmt::format("cannot be opened as HDF5: {}", reason()),
                "Was it cut short, or is it still being written?");
  handle = File(opened);
  read_times();
  read_dts();
  read_node_ids();
}

Dataset HistoryReader::Impl::open_dataset(const std::string& name, bool integers_only) const {
  if (!has(name))
    refuse_file(file, fmt::format("has no dataset /{}", name), "See client/replay/README.md for what a history holds.",
                name);
  check_link(name);
  const hid_t opened = H5Oopen(handle, name.c_str(), H5P_DEFAULT);
  if (opened < 0) fail(name, fmt::format("cannot be opened: {}", reason()), "");
  const Object object(opened);
  if (H5Iget_type(object) != H5I_DATASET) fail(name, "is not a dataset", "Expected an array of numbers.");
  Dataset dataset = open_values(name);
  const Type type = type_of(dataset);
  const H5T_class_t found = H5Tget_class(type);
  const bool is_regime = found == H5T_ENUM && name == "regime" && H5Tget_size(type) == 1;
  const bool fits = found == H5T_INTEGER || ((found == H5T_FLOAT || is_regime) && !integers_only);
  if (!fits)
    fail(name, fmt::format("holds {} values; expected {}", class_name(found), integers_only ? "integers" : "numbers"),
         integers_only ? "Write it as uint64." : "Write it as float64.");
  return dataset;
}

void HistoryReader::Impl::check_link(const std::string& name) const {
  if (const std::string fault = fault_of_link(handle, name); !fault.empty())
    fail(name, fault, "A history is one file: copy the values into it.");
}

// Opens a dataset whose values are in the file itself.
Dataset HistoryReader::Impl::open_values(const std::string& name) const {
  Dataset dataset = hdf5::open_dataset(handle, name);
  if (const StorageFault found = fault_of_place(dataset); !found.fault.empty()) fail(name, found.fault, found.remedy);
  return dataset;
}

void HistoryReader::Impl::check_storage(const std::string& name, hid_t dataset) const {
  if (const StorageFault found = fault_of_storage(dataset); !found.fault.empty()) fail(name, found.fault, found.remedy);
}

// The factor by which the values of a dataset are converted, by its attribute `units`; none: they are SI.
double HistoryReader::Impl::factor_to_si(const std::string& name, hid_t dataset) const {
  if (!has_attribute(dataset, "units")) return 1.0;
  const bool parameter = name.starts_with("parameter/");
  const char* const si = wire::unit_of_quantity(name);
  if (si == nullptr || (*si == '\0' && !parameter)) return 1.0;
  const Attribute attribute = open_attribute(dataset, "units");
  if (!is_one_text(attribute))
    fail(name, "has an attribute units that is not one text", fmt::format("Write it as text, such as \"{}\".", si));
  const std::string unit = read_texts(attribute).front();
  if (parameter) {
    if (unit.empty() || unit == "1") return 1.0;
    fail(name,
         fmt::format("has units {}; a parameter is in the unit that the key of the scene has", wire::in_quotes(unit)),
         "Convert the values if need be, and leave the attribute out.");
  }
  if (const auto factor = wire::factor_to_si(unit, si)) return *factor;
  fail(name,
       fmt::format("has units {}; expected {}", wire::in_quotes(unit),
                   std::string_view(si) == "1" ? "1" : wire::known_units(si)),
       "Convert the values and say their unit in the attribute units; without it they are SI.");
}

std::size_t HistoryReader::Impl::length(const std::string& name, hid_t dataset, const char* letter,
                                        std::size_t most) const {
  const Shape found = shape_of(dataset);
  if (found.size() != 1)
    fail(name, fmt::format("has shape {}; expected one dimension, [{}]", shape_text(found), letter), "");
  if (found[0] == 0) fail(name, "has no values; expected at least one", "");
  if (found[0] > most)
    fail(name, fmt::format("has {} values; at most {} are allowed", found[0], most), "Split the history.");
  return found[0];
}

void HistoryReader::Impl::read_all(const std::string& name, hid_t dataset, hid_t memory_type, void* values) const {
  check_storage(name, dataset);
  if (H5Dread(dataset, memory_type, H5S_ALL, H5S_ALL, H5P_DEFAULT, values) < 0)
    fail(name, fmt::format("cannot be read: {}", reason()), "Is the file damaged?");
}

void HistoryReader::Impl::read_start_time(hid_t time, double to_si) {
  if (!has_attribute(time, "t0")) return;
  const Attribute attribute = open_attribute(time, "t0");
  const H5T_class_t found = H5Tget_class(type_of(attribute));
  if ((found != H5T_FLOAT && found != H5T_INTEGER) || count_of(attribute) != 1)
    fail("time", "has an attribute t0 that is not one number", "Write the start of the first step in seconds.");
  hdf5::read(attribute, H5T_NATIVE_DOUBLE, &start_time);
  start_time *= to_si;
  has_start = true;
  if (!std::isfinite(start_time))
    fail("time", fmt::format("has attribute t0 = {}; expected a finite number", start_time), "");
}

void HistoryReader::Impl::read_times() {
  const Dataset dataset = open_dataset("time");
  times.resize(length("time", dataset, "T", kMaxSteps));
  read_all("time", dataset, H5T_NATIVE_DOUBLE, times.data());
  const double to_si = factor_to_si("time", dataset);
  convert(times, to_si);
  read_start_time(dataset, to_si);
  double before = start_time;
  for (std::size_t i = 0; i < times.size(); before = times[i++]) {
    if (!std::isfinite(times[i])) fail("time", fmt::format("[{}] is {}; expected a finite number", i, times[i]), "");
    if (times[i] > before) continue;
    if (i == 0)
      fail("time", fmt::format("[0] is {} s, not after the start {} s", times[0], start_time),
           "/time holds the end of each step; attribute t0 the start of the first.");
    fail("time", fmt::format("[{}] is {} s, not after [{}] = {} s", i, times[i], i - 1, before),
         "Times must increase.");
  }
}

void HistoryReader::Impl::read_dts() {
  dts.resize(times.size());
  for (std::size_t i = 0; i < times.size(); ++i) dts[i] = times[i] - (i == 0 ? start_time : times[i - 1]);
  if (!has("dt")) return;
  const Dataset dataset = open_dataset("dt");
  std::vector<double> given(length("dt", dataset, "T", kMaxSteps));
  if (given.size() != times.size()) fail("dt", fmt::format("has {} values, /time {}", given.size(), times.size()), "");
  read_all("dt", dataset, H5T_NATIVE_DOUBLE, given.data());
  convert(given, factor_to_si("dt", dataset));
  if (!has_start && given[0] > 0 && given[0] < dts[0] * (1 - 1e-6)) {  // the clock begins later than at 0
    dts[0] = given[0];
    start_time = times[0] - given[0];
  }
  for (std::size_t i = 0; i < times.size(); ++i) {
    // Allows the rounding error of a sum of steps, also of a host that keeps its time in single precision.
    const double allowed = 1e-6 * (dts[i] + std::abs(times[i]));
    if (!(given[i] > 0 && std::abs(given[i] - dts[i]) <= allowed))
      fail("dt",
           fmt::format("[{}] is {} s; the step from {} to {} s takes {} s", i, given[i], times[i] - dts[i], times[i],
                       dts[i]),
           "Leave /dt out to use the differences of /time.");
  }
  dts = std::move(given);
}

void HistoryReader::Impl::read_node_ids() {
  const std::string name = "node_id";
  const Dataset dataset = open_dataset(name, true);
  node_ids.resize(length(name, dataset, "N", wire::kMaxNodesPerSession));
  if (H5Tget_sign(type_of(dataset)) == H5T_SGN_2) {
    std::vector<std::int64_t> given(node_ids.size());
    read_all(name, dataset, H5T_NATIVE_INT64, given.data());
    for (std::size_t i = 0; i < given.size(); ++i) {
      if (given[i] < 0) fail(name, fmt::format("[{}] is {}; node ids are not negative", i, given[i]), "");
      node_ids[i] = static_cast<std::uint64_t>(given[i]);
    }
  } else {
    read_all(name, dataset, H5T_NATIVE_UINT64, node_ids.data());
  }
  std::unordered_map<std::uint64_t, std::size_t> places;
  places.reserve(node_ids.size());
  for (std::size_t i = 0; i < node_ids.size(); ++i) {
    const auto [earlier, fresh] = places.emplace(node_ids[i], i);
    if (!fresh)
      fail(name, fmt::format("[{}] repeats node {} of [{}]", i, node_ids[i], earlier->second),
           "Each node is named once.");
  }
}

HistoryReader::Impl::Series& HistoryReader::Impl::open_series(const std::string& name) {
  if (const auto found = series.find(name); found != series.end()) return found->second;
  Series one;
  one.dataset = open_dataset(name);
  const Shape found = shape_of(one.dataset);
  if (found != Shape{times.size(), node_ids.size()})
    fail(name,
         fmt::format("has shape {}; expected [T, N] = [{}, {}]", shape_text(found), times.size(), node_ids.size()),
         "One row for each time, one column for each node.");

  check_storage(name, one.dataset);
  one.to_si = factor_to_si(name, one.dataset);
  one.rows_per_read = std::max<std::size_t>(kBufferElements / node_ids.size(), 1);
  const Properties creation = creation_of(one.dataset);
  if (H5Pget_layout(creation) == H5D_CHUNKED) {
    // The dataset is read some rows at a time, and a chunk spans several rows. The cache holds the chunks of all nodes
    // for these rows (up to kMaxChunkCacheBytes), so that each chunk is unpacked once.
    std::array<hsize_t, 2> chunk{};
    checked(H5Pget_chunk(creation, 2, chunk.data()), "read the chunks of ", name);
    const std::size_t across = (node_ids.size() + chunk[1] - 1) / chunk[1] * chunk[1];
    const std::size_t band = chunk[0] * H5Tget_size(type_of(one.dataset)) * across;
    const Properties access(checked(H5Pcreate(H5P_DATASET_ACCESS), "make a property list"));
    checked(H5Pset_chunk_cache(access, H5D_CHUNK_CACHE_NSLOTS_DEFAULT,
                               std::clamp<std::size_t>(band, 1 << 20, kMaxChunkCacheBytes), H5D_CHUNK_CACHE_W0_DEFAULT),
            "set a cache of chunks");
    one.dataset = Dataset();
    one.dataset = Dataset(checked(H5Dopen2(handle, name.c_str(), access), "find dataset ", name));
  }
  return series.emplace(name, std::move(one)).first->second;
}

void HistoryReader::Impl::load_rows(const std::string& name, Series& one, std::size_t step) const {
  const std::size_t nodes = node_ids.size();
  one.count = 0;  // until the read succeeds, no rows are in memory
  const std::size_t count = std::min(one.rows_per_read, times.size() - step);
  one.values.resize(count * nodes);
  try {
    const Type type = type_of(one.dataset);
    if (H5Tget_class(type) == H5T_ENUM) {  // HDF5 converts an enum to no number
      std::vector<std::uint8_t> codes(count * nodes);
      read_rows(one.dataset, type, step, {count, nodes}, codes.data());
      one.values.assign(codes.begin(), codes.end());
    } else {
      read_rows(one.dataset, H5T_NATIVE_DOUBLE, step, {count, nodes}, one.values.data());
    }
  } catch (const Error& fault) {
    fail(name, fmt::format("rows {} to {} cannot be read: {}", step, step + count - 1, fault.what()),
         "Is the file damaged?");
  }
  convert(one.values, one.to_si);
  one.first = step;
  one.count = count;
}

// Reads all texts of an attribute or a dataset of texts.
std::vector<std::string> HistoryReader::Impl::read_texts(hid_t from) const {
  const Type type = type_of(from);
  if (const std::size_t width = H5Tget_size(type); H5Tis_variable_str(type) <= 0 && width > kMaxTextWidth)
    refuse_file(file, fmt::format("has texts of {} bytes; at most {} are read", width, kMaxTextWidth));
  return texts_of(from);
}

std::string HistoryReader::Impl::read_text(hid_t from) const {
  if (!is_one_text(from)) refuse_file(file, "holds something other than one text in /meta");
  return read_texts(from).front();
}

HistoryReader::HistoryReader(fs::path file) : impl_(std::make_unique<Impl>()), axes_(impl_.get()) {
  impl_->file = std::move(file);
  impl_->reading([&] { impl_->open(); });
}

HistoryReader::HistoryReader(HistoryReader&&) noexcept = default;
HistoryReader& HistoryReader::operator=(HistoryReader&&) noexcept = default;
HistoryReader::~HistoryReader() = default;

bool HistoryReader::has(std::string_view name) const {
  return impl_->reading([&] { return impl_->has(name); });
}

std::vector<double> HistoryReader::per_node(std::string_view name_view) const {
  const Impl& self = *impl_;
  const std::string name(name_view);
  std::vector<double> values(nodes());
  self.reading([&] {
    const Dataset dataset = self.open_dataset(name);
    if (const Shape found = shape_of(dataset); found != Shape{nodes()})
      self.fail(name, fmt::format("has shape {}; expected [N] = [{}]", shape_text(found), nodes()),
                "One value for each node.");
    self.read_all(name, dataset, H5T_NATIVE_DOUBLE, values.data());
    convert(values, self.factor_to_si(name, dataset));
  });
  for (std::size_t i = 0; i < values.size(); ++i)
    if (!std::isfinite(values[i]))
      self.fail(name, fmt::format("[{}] (node {}) is {}; expected a finite number", i, self.node_ids[i], values[i]),
                "");
  return values;
}

std::vector<std::string> HistoryReader::texts(std::string_view name_view) const {
  const Impl& self = *impl_;
  const std::string name(name_view);
  return self.reading([&] {
    self.check_link(name);
    if (H5Iget_type(Object(H5Oopen(self.handle, name.c_str(), H5P_DEFAULT))) != H5I_DATASET)
      self.fail(name, "is not a dataset", "Expected one text for each node.");
    const Dataset dataset = self.open_values(name);
    if (const H5T_class_t found = H5Tget_class(type_of(dataset)); found != H5T_STRING)
      self.fail(name, fmt::format("holds {} values; expected texts", class_name(found)),
                "Write one name for each node.");
    if (const Shape found = shape_of(dataset); found != Shape{nodes()})
      self.fail(name, fmt::format("has shape {}; expected [N] = [{}]", shape_text(found), nodes()),
                "One text for each node.");
    self.check_storage(name, dataset);
    return self.read_texts(dataset);
  });
}

std::vector<std::string> HistoryReader::names_in(std::string_view group_view) const {
  const Impl& self = *impl_;
  const std::string name(group_view);
  return self.reading([&] {
    if (!name.empty() && !self.has(name)) return std::vector<std::string>();
    if (!name.empty()) self.check_link(name);
    const Object group(checked(H5Oopen(self.handle, ('/' + name).c_str(), H5P_DEFAULT), "find group /", name));
    if (H5Iget_type(group) != H5I_GROUP) self.fail(name, "is not a group", "Expected a group of datasets.");
    return children_of(group);
  });
}

void HistoryReader::row(std::string_view name_view, std::size_t step, std::span<double> values) {
  Impl& self = *impl_;
  const std::string name(name_view);
  if (step >= steps() || values.size() != nodes())
    self.fail(
        name,
        fmt::format("was asked for row {} of {} with room for {} of {} values", step, steps(), values.size(), nodes()),
        "");
  const Impl::Series& one = self.reading([&]() -> Impl::Series& {
    Impl::Series& opened = self.open_series(name);
    if (step < opened.first || step >= opened.first + opened.count) self.load_rows(name, opened, step);
    return opened;
  });
  const std::span<const double> row{one.values.data() + (step - one.first) * nodes(), nodes()};
  for (std::size_t i = 0; i < row.size(); ++i)
    if (!std::isfinite(row[i]))
      self.fail(name,
                fmt::format("[{}, {}] (time {} s, node {}) is {}; expected a finite number", step, i, self.times[step],
                            self.node_ids[i], row[i]),
                "");
  std::ranges::copy(row, values.begin());
}

std::optional<std::string> HistoryReader::meta(std::string_view name_view) const {
  const Impl& self = *impl_;
  const std::string name(name_view);
  return self.reading([&]() -> std::optional<std::string> {
    if (!self.has("meta")) return std::nullopt;
    self.check_link("meta");
    const Object group(checked(H5Oopen(self.handle, "meta", H5P_DEFAULT), "find /meta"));
    if (has_attribute(group, name)) return self.read_text(open_attribute(group, name));
    const std::string path = "meta/" + name;
    if (H5Iget_type(group) != H5I_GROUP || !self.has(path)) return std::nullopt;
    self.check_link(path);
    const Dataset text = self.open_values(path);
    self.check_storage(path, text);
    return self.read_text(text);
  });
}

std::string hash_of_file(const fs::path& file) {
  const RegularFile input(file);
  const std::unique_ptr<XXH3_state_t, XXH_errorcode (*)(XXH3_state_t*)> state(XXH3_createState(), XXH3_freeState);
  XXH3_64bits_reset(state.get());
  std::vector<char> block(1 << 20);
  while (const std::size_t size = input.read(block.data(), block.size()))
    XXH3_64bits_update(state.get(), block.data(), size);
  return fmt::format("xxh3-64:{:016x}", XXH3_64bits_digest(state.get()));
}

}  // namespace shearbus::files
