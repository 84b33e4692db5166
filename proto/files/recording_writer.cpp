#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "proto/files/recording.hpp"
#include "proto/files/recording_hdf5.hpp"
#include "proto/wire/enum_names.hpp"
#include "proto/wire/messages.hpp"
#include "proto/wire/text.hpp"

namespace shearbus::files {
namespace {

namespace fs = std::filesystem;
using namespace hdf5;

// Rows wait until they fill a chunk of this size. The end of the last chunk may remain unused, so a chunk is no larger
// than writing needs to be fast. A longer row is a chunk by itself, or several of equal width.
constexpr std::size_t kChunkElements = 8'192;      // 64 KiB of doubles
constexpr std::size_t kMaxChunkWidth = 65'536;     // 512 KiB of doubles
constexpr std::size_t kTimesPerChunk = 1'024;      // 8 KiB of doubles
constexpr std::size_t kMaxAttributeBytes = 4'096;  // longer texts are datasets; HDF5's own limit is 64 KiB

// Returns the width of the fewest equal parts of `size` that are at most `most` wide; the last part may be narrower.
std::size_t even_part(std::size_t size, std::size_t most) {
  const std::size_t parts = std::max<std::size_t>((size + most - 1) / most, 1);
  return std::max<std::size_t>((size + parts - 1) / parts, 1);
}

std::string legend_of_regimes() {
  std::string text;
  for (std::size_t regime = 0; regime < wire::kRegimeCount; ++regime)
    text += fmt::format("{}{} {}", regime == 0 ? "" : ", ", regime, wire::regime_name(regime));
  return text;
}

// "0 ok, or a sum of: 1 substepped, 2 multiple roots, ..."
std::string legend_of_outcomes() {
  std::string text = "0 ok, or a sum of:";
  for (const wire::EnumValue& bit : wire::names_of(wire::Outcome{}).values) {
    if (bit.number == 0) continue;
    std::string name = bit.name;
    for (char& letter : name) letter = letter == '_' ? ' ' : wire::ascii_lower(letter);
    text += fmt::format("{} {} {}", bit.number == 1 ? "" : ",", bit.number, name);
  }
  return text;
}

// Whether a file is a history as this class writes it: /meta has the attribute `format`.
bool is_history(const fs::path& file) {
  const Quiet quiet;
  if (!kHdf5File.recognises(file)) return false;
  const File handle(H5Fopen(file.c_str(), H5F_ACC_RDONLY, H5P_DEFAULT));
  H5L_info_t link{};
  if (handle < 0 || H5Lget_info(handle, "meta", &link, H5P_DEFAULT) < 0 || link.type != H5L_TYPE_HARD) return false;
  const Attribute format(H5Aopen_by_name(handle, "meta", "format", H5P_DEFAULT, H5P_DEFAULT));
  if (format < 0) return false;
  const Type type(H5Aget_type(format));
  const Space space(H5Aget_space(format));
  if (H5Tis_variable_str(type) <= 0 || H5Sget_simple_extent_npoints(space) != 1) return false;
  char* text = nullptr;
  if (H5Aread(format, type, static_cast<void*>(&text)) < 0 || text == nullptr) return false;
  const bool found = std::string_view(text) == "shearbus-history";
  H5free_memory(text);
  return found;
}

}  // namespace

const FileKind kHistoryFile = {"a history or result (HDF5) of shearbus", is_history};

struct HistoryWriter::Impl {
  struct Series {
    Quantity quantity;
    bool bytes = false;
    Type type;  // number type of the dataset in the file
    Dataset dataset;
    std::vector<double> numbers;  // buffered rows of a float64 dataset; rows of a byte dataset are in `codes`
    std::vector<std::uint8_t> codes;
    bool set = false;  // true if the values of the current row (one step) are already set
  };

  PartialFile partial;
  const fs::path& file;
  File handle;
  Dataset time;
  Dataset dt;
  bool has_dt = false;  // true if each step is written with its length
  std::vector<Series> series;
  std::size_t nodes = 0;
  std::size_t rows_per_chunk = 1;
  std::size_t chunk_width = 1;
  std::vector<double> waiting_times;
  std::vector<double> waiting_dts;
  double start_time = 0.0;
  double last_time = 0.0;
  std::size_t rows_written = 0;
  bool row_open = false;

  explicit Impl(const fs::path& name)
      : partial(name, kHistoryFile, PartialFile::Writers::kOne), file(partial.file()), handle(create_file(partial)) {}
  Impl(const Impl&) = delete;
  Impl& operator=(const Impl&) = delete;
  ~Impl() {
    const Quiet quiet;
    close_objects();
    handle.close();
  }

  // Closes all objects of the file, because a file with open objects would stay open.
  herr_t close_objects() {
    herr_t worst = std::min(time.close(), dt.close());
    for (Series& one : series) worst = std::min({worst, one.dataset.close(), one.type.close()});
    return worst;
  }

  template <typename T>
  T check(T returned, const char* what) const {
    return checked(returned, file, what);
  }

  Properties chunked(std::span<const hsize_t> chunk) const;
  // `grows`: the first size has no limit
  Dataset create_dataset(const std::string& name, hid_t type, const std::vector<hsize_t>& size,
                         const std::vector<hsize_t>& chunk, bool grows) const;
  void write_text(hid_t object, const std::string& name, const std::string& text) const;
  void write_units(hid_t dataset, const std::string& units) const;
  void write_meta(const std::map<std::string, std::string>& meta) const;
  void describe_dataset(hid_t dataset, const Quantity& quantity) const;
  void write_array(const Quantity& quantity, hid_t type, hid_t memory_type, const void* values,
                   const std::vector<hsize_t>& shape) const;
  void append(hid_t dataset, hid_t memory_type, const void* values, std::size_t rows, bool per_node) const;
  void add_series(Quantity quantity);
  void create_series(std::size_t rows_a_chunk);
  Series& in_open_row(std::size_t quantity, std::size_t count, bool bytes);
  void write_waiting_rows();
};

Properties HistoryWriter::Impl::chunked(std::span<const hsize_t> chunk) const {
  Properties creation(check(H5Pcreate(H5P_DATASET_CREATE), "cannot prepare a dataset"));
  check(H5Pset_chunk(creation, static_cast<int>(chunk.size()), chunk.data()), "cannot set chunks");
  check(H5Pset_fletcher32(creation), "cannot set fletcher32");
  return creation;
}

Dataset HistoryWriter::Impl::create_dataset(const std::string& name, hid_t type, const std::vector<hsize_t>& size,
                                            const std::vector<hsize_t>& chunk, bool grows) const {
  std::vector<hsize_t> most = size;
  if (grows) most.front() = H5S_UNLIMITED;
  const Space space(
      check(H5Screate_simple(static_cast<int>(size.size()), size.data(), most.data()), "cannot set a size"));
  return Dataset(check(H5Dcreate2(handle, name.c_str(), type, space, H5P_DEFAULT, chunked(chunk), H5P_DEFAULT),
                       "cannot create a dataset"));
}

void HistoryWriter::Impl::write_text(hid_t object, const std::string& name, const std::string& text) const {
  const Type type(check(H5Tcopy(H5T_C_S1), "cannot prepare a text"));
  check(H5Tset_size(type, H5T_VARIABLE), "cannot prepare a text");
  check(H5Tset_cset(type, H5T_CSET_UTF8), "cannot prepare a text");
  const Space scalar(check(H5Screate(H5S_SCALAR), "cannot prepare a text"));
  const char* const start = text.c_str();
  if (text.find('\n') == std::string::npos && text.size() <= kMaxAttributeBytes) {
    const Attribute attribute(
        check(H5Acreate2(object, name.c_str(), type, scalar, H5P_DEFAULT, H5P_DEFAULT), "cannot create an attribute"));
    check(H5Awrite(attribute, type, &start), "cannot write an attribute");
  } else {
    const Dataset dataset(check(H5Dcreate2(object, name.c_str(), type, scalar, H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT),
                                "cannot create a text"));
    check(H5Dwrite(dataset, type, H5S_ALL, H5S_ALL, H5P_DEFAULT, &start), "cannot write a text");
  }
}

// A reader converts by this text, so it is of fixed length: it lies in the header of its dataset, which has a checksum.
void HistoryWriter::Impl::write_units(hid_t dataset, const std::string& units) const {
  const Type type(check(H5Tcopy(H5T_C_S1), "cannot prepare a unit"));
  check(H5Tset_size(type, units.size()), "cannot prepare a unit");
  check(H5Tset_strpad(type, H5T_STR_NULLPAD), "cannot prepare a unit");
  check(H5Tset_cset(type, H5T_CSET_UTF8), "cannot prepare a unit");
  const Space scalar(check(H5Screate(H5S_SCALAR), "cannot prepare a unit"));
  const Attribute attribute(
      check(H5Acreate2(dataset, "units", type, scalar, H5P_DEFAULT, H5P_DEFAULT), "cannot create a unit"));
  check(H5Awrite(attribute, type, units.data()), "cannot write a unit");
}

void HistoryWriter::Impl::write_meta(const std::map<std::string, std::string>& meta) const {
  const Group group(check(H5Gopen2(handle, "meta", H5P_DEFAULT), "cannot open /meta"));
  for (const auto& [name, text] : meta) write_text(group, name, text);
}

void HistoryWriter::Impl::describe_dataset(hid_t dataset, const Quantity& quantity) const {
  if (!quantity.units.empty()) write_units(dataset, quantity.units);
  write_text(dataset, "long_name", quantity.long_name);
  if (quantity.is_regime) write_text(dataset, "legend", legend_of_regimes());
  if (quantity.is_outcome) write_text(dataset, "legend", legend_of_outcomes());
}

void HistoryWriter::Impl::add_series(Quantity quantity) {
  Series one;
  one.bytes = quantity.is_regime || quantity.is_outcome;
  if (quantity.is_regime) {
    one.type = Type(check(H5Tenum_create(H5T_STD_U8LE), "cannot create the regime type"));
    for (const wire::EnumValue& regime : wire::names_of(wire::Regime{}).values) {
      const auto value = static_cast<std::uint8_t>(regime.number);
      check(H5Tenum_insert(one.type, regime.name, &value), "cannot create the regime type");
    }
  } else {
    one.type = Type(check(H5Tcopy(one.bytes ? H5T_STD_U8LE : H5T_IEEE_F64LE), "cannot create a type"));
  }
  one.quantity = std::move(quantity);
  series.push_back(std::move(one));
}

// Creates the datasets that have a row for each step, unless they exist.
void HistoryWriter::Impl::create_series(std::size_t rows_a_chunk) {
  if (time >= 0) return;
  const bool all_rows = rows_a_chunk < rows_per_chunk;  // true if the history ends before it fills a chunk
  const std::vector<hsize_t> times = {all_rows ? rows_a_chunk : std::max(rows_a_chunk, kTimesPerChunk)};
  time = create_dataset("time", H5T_IEEE_F64LE, {0}, times, true);
  describe_dataset(time, {"time", "s", "end of the step"});
  const Space scalar(check(H5Screate(H5S_SCALAR), "cannot create t0"));
  const Attribute t0(
      check(H5Acreate2(time, "t0", H5T_IEEE_F64LE, scalar, H5P_DEFAULT, H5P_DEFAULT), "cannot create t0"));
  check(H5Awrite(t0, H5T_NATIVE_DOUBLE, &start_time), "cannot write t0");
  if (has_dt) {
    dt = create_dataset("dt", H5T_IEEE_F64LE, {0}, times, true);
    describe_dataset(dt, {"dt", "s", "length of the step as the host took it"});
  }
  for (Series& one : series) {
    one.dataset = create_dataset(one.quantity.name, one.type, {0, nodes}, {rows_a_chunk, chunk_width}, true);
    describe_dataset(one.dataset, one.quantity);
  }
}

void HistoryWriter::Impl::append(hid_t dataset, hid_t memory_type, const void* values, std::size_t rows,
                                 bool per_node) const {
  const int rank = per_node ? 2 : 1;
  const hsize_t size[2] = {rows_written + rows, nodes};
  const hsize_t start[2] = {rows_written, 0};
  const hsize_t count[2] = {rows, nodes};
  check(H5Dset_extent(dataset, size), "cannot grow a dataset");
  const Space space(check(H5Dget_space(dataset), "cannot grow a dataset"));
  check(H5Sselect_hyperslab(space, H5S_SELECT_SET, start, nullptr, count, nullptr), "cannot select rows");
  const Space memory(check(H5Screate_simple(rank, count, nullptr), "cannot select rows"));
  check(H5Dwrite(dataset, memory_type, memory, space, H5P_DEFAULT, values), "cannot write rows");
}

void HistoryWriter::Impl::write_waiting_rows() {
  const std::size_t rows = waiting_times.size();
  create_series(std::max<std::size_t>(rows, 1));
  if (rows == 0) return;
  append(time, H5T_NATIVE_DOUBLE, waiting_times.data(), rows, false);
  if (has_dt) append(dt, H5T_NATIVE_DOUBLE, waiting_dts.data(), rows, false);
  for (Series& one : series) {
    if (one.bytes)
      append(one.dataset, one.type, one.codes.data(), rows, true);
    else
      append(one.dataset, H5T_NATIVE_DOUBLE, one.numbers.data(), rows, true);
    one.numbers.clear();
    one.codes.clear();
  }
  check_written(handle, file);  // ends a long run at its first failed write
  rows_written += rows;
  waiting_times.clear();
  waiting_dts.clear();
}

HistoryWriter::Impl::Series& HistoryWriter::Impl::in_open_row(std::size_t quantity, std::size_t count, bool bytes) {
  if (!row_open) refuse(file, "values outside a row", "Call begin_row first.");
  Series& one = series.at(quantity);
  const std::string& name = one.quantity.name;
  if (one.bytes != bytes)
    refuse(file,
           fmt::format("/{} takes {}, given {}", name, one.bytes ? "uint8" : "float64", bytes ? "uint8" : "float64"),
           {}, name);
  if (count != nodes) refuse(file, fmt::format("/{} takes {} values a row, given {}", name, nodes, count), {}, name);
  if (one.set) refuse(file, fmt::format("/{} is set twice in one row", name), {}, name);
  one.set = true;
  return one;
}

void HistoryWriter::Impl::write_array(const Quantity& quantity, hid_t type, hid_t memory_type, const void* values,
                                      const std::vector<hsize_t>& shape) const {
  if (const std::size_t slash = quantity.name.find('/'); slash != std::string::npos) {
    const std::string group = quantity.name.substr(0, slash);
    if (H5Lexists(handle, group.c_str(), H5P_DEFAULT) <= 0)
      const Group made(
          check(H5Gcreate2(handle, group.c_str(), H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT), "cannot create a group"));
  }
  std::vector<hsize_t> chunk = shape;  // the values of one time, or of one node
  hsize_t elements = 1;
  for (std::size_t i = chunk.size(); i-- > 0;) {
    chunk[i] = even_part(chunk[i], std::max<hsize_t>(kMaxChunkWidth / elements, 1));
    elements *= chunk[i];
  }
  const Dataset dataset = create_dataset(quantity.name, type, shape, chunk, false);
  describe_dataset(dataset, quantity);
  check(H5Dwrite(dataset, memory_type, H5S_ALL, H5S_ALL, H5P_DEFAULT, values), "cannot write a dataset");
}

Quantity quantity_of_column(wire::Field field, std::uint32_t component, const std::string& long_name) {
  const wire::ColumnRow& row = wire::column_row(field);
  return {.name = wire::quantity_of(field, component),
          .units = wire::units_in_files(row),
          .long_name = (long_name.empty() ? row.meaning : long_name) + (component == 0 ? "" : ", second direction"),
          .is_regime = field == wire::Field::kRegime,
          .is_outcome = field == wire::Field::kOutcome};
}

HistoryWriter::HistoryWriter(fs::path file, std::span<const std::uint64_t> node_ids, std::vector<Quantity> quantities,
                             const std::map<std::string, std::string>& meta, double start_time_s) {
  const Quiet quiet;
  if (node_ids.empty()) refuse(file, "a history of no nodes", "Name at least one node.");
  impl_ = std::make_unique<Impl>(file);
  Impl& self = *impl_;
  self.nodes = node_ids.size();
  self.rows_per_chunk = std::max<std::size_t>(kChunkElements / self.nodes, 1);
  self.chunk_width = even_part(self.nodes, kMaxChunkWidth);
  self.start_time = self.last_time = start_time_s;
  const Dataset ids = self.create_dataset("node_id", H5T_STD_U64LE, {self.nodes}, {self.chunk_width}, false);
  self.describe_dataset(ids, {"node_id", "1", "the host's number of the interface node"});
  self.check(H5Dwrite(ids, H5T_NATIVE_UINT64, H5S_ALL, H5S_ALL, H5P_DEFAULT, node_ids.data()), "cannot write /node_id");
  for (Quantity& quantity : quantities) self.add_series(std::move(quantity));

  const Group group(
      self.check(H5Gcreate2(self.handle, "meta", H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT), "cannot create /meta"));
  self.write_meta(
      {{"format", "shearbus-history"}, {"version", "1"}, {"created", wire::utc_now()}, {"units_system", "SI"}});
  self.write_meta(meta);
}

HistoryWriter::HistoryWriter(HistoryWriter&&) noexcept = default;
HistoryWriter& HistoryWriter::operator=(HistoryWriter&&) noexcept = default;
HistoryWriter::~HistoryWriter() = default;

bool HistoryWriter::replaces() const {
  return impl_->partial.replaces();
}

void HistoryWriter::begin_row(double time_s, std::optional<double> dt_s) {
  const Quiet quiet;
  Impl& self = *impl_;
  if (self.row_open) refuse(self.file, "a row begins inside a row", "Call end_row first.");
  if (!std::isfinite(time_s) || time_s <= self.last_time)
    refuse(self.file, fmt::format("a row at {} s after one that ends at {} s", time_s, self.last_time),
           "Times must increase.", "time");
  if (self.rows_written + self.waiting_times.size() == 0) self.has_dt = dt_s.has_value();
  if (dt_s.has_value() != self.has_dt)
    refuse(self.file, fmt::format("the row at {} s breaks the rule that all rows have a dt or none", time_s), {}, "dt");
  self.waiting_times.push_back(time_s);
  if (dt_s) self.waiting_dts.push_back(*dt_s);
  self.last_time = time_s;
  self.row_open = true;
  for (Impl::Series& one : self.series) one.set = false;
}

void HistoryWriter::set(std::size_t quantity, std::span<const double> values) {
  Impl::Series& one = impl_->in_open_row(quantity, values.size(), false);
  one.numbers.insert(one.numbers.end(), values.begin(), values.end());
}

void HistoryWriter::set(std::size_t quantity, std::span<const std::uint8_t> values) {
  Impl::Series& one = impl_->in_open_row(quantity, values.size(), true);
  one.codes.insert(one.codes.end(), values.begin(), values.end());
}

void HistoryWriter::end_row() {
  const Quiet quiet;
  Impl& self = *impl_;
  if (!self.row_open) refuse(self.file, "a row ends that never began", "Call begin_row first.");
  for (const Impl::Series& one : self.series)
    if (!one.set)
      refuse(self.file, fmt::format("/{} has no values in the row at {} s", one.quantity.name, self.last_time), {},
             one.quantity.name);
  self.row_open = false;
  if (self.waiting_times.size() == self.rows_per_chunk) self.write_waiting_rows();
}

void HistoryWriter::add_static(const Quantity& quantity, std::span<const double> values) {
  if (values.empty()) refuse(impl_->file, fmt::format("/{} has no values", quantity.name), {}, quantity.name);
  add_array(quantity, values, {values.size()});
}

void HistoryWriter::add_array(const Quantity& quantity, std::span<const double> values,
                              const std::vector<std::size_t>& shape) {
  const Quiet quiet;
  impl_->write_array(quantity, H5T_IEEE_F64LE, H5T_NATIVE_DOUBLE, values.data(), {shape.begin(), shape.end()});
}

void HistoryWriter::add_ids(const Quantity& quantity, std::span<const std::uint64_t> ids) {
  const Quiet quiet;
  impl_->write_array(quantity, H5T_STD_U64LE, H5T_NATIVE_UINT64, ids.data(), {ids.size()});
}

void HistoryWriter::add_texts(const Quantity& quantity, std::span<const std::string> texts) {
  const Quiet quiet;
  const Impl& self = *impl_;
  std::size_t width = 1;  // texts of one width, so that the checksum covers them
  for (const std::string& text : texts) width = std::max(width, text.size());
  const Type type(self.check(H5Tcopy(H5T_C_S1), "cannot describe a text"));
  self.check(H5Tset_size(type, width), "cannot describe a text");
  self.check(H5Tset_strpad(type, H5T_STR_NULLPAD), "cannot describe a text");
  self.check(H5Tset_cset(type, H5T_CSET_UTF8), "cannot describe a text");
  std::string cells(texts.size() * width, '\0');
  for (std::size_t i = 0; i < texts.size(); ++i) texts[i].copy(cells.data() + i * width, width);
  self.write_array(quantity, type, type, cells.data(), {texts.size()});
}

void HistoryWriter::close(const std::map<std::string, std::string>& closing_meta) {
  const Quiet quiet;
  Impl& self = *impl_;
  if (self.row_open) refuse(self.file, "closed inside a row", "Call end_row first.");
  self.write_waiting_rows();
  self.write_meta(closing_meta);
  self.check(self.close_objects(), "cannot close");
  close_and_publish(self.handle, self.partial);
}

}  // namespace shearbus::files
