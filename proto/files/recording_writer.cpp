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

// Writes a text of any length: of one line as an attribute, a longer one as a dataset.
void write_text(hid_t object, const std::string& name, const std::string& text) {
  const Type type = text_type(H5T_VARIABLE);
  const char* const start = text.c_str();
  if (text.find('\n') == std::string::npos && text.size() <= kMaxAttributeBytes)
    put_attribute(object, name, type, &start);
  else
    hdf5::write(make_dataset(object, name, type, {}), type, &start);
}

// Whether a file is a history as this class writes it: /meta has the attribute `format`.
bool is_history(const fs::path& file) try {
  const Quiet quiet;
  if (!kHdf5File.recognises(file)) return false;
  const File handle(checked(H5Fopen(file.c_str(), H5F_ACC_RDONLY, H5P_DEFAULT), "open it"));
  H5L_info_t link{};
  if (H5Lget_info(handle, "meta", &link, H5P_DEFAULT) < 0 || link.type != H5L_TYPE_HARD) return false;
  const Attribute format = open_attribute(Object(H5Oopen(handle, "meta", H5P_DEFAULT)), "format");
  return is_one_text(format) && H5Tis_variable_str(type_of(format)) > 0 &&
         texts_of(format).front() == "shearbus-history";
} catch (const Error&) {
  return false;
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

  OutputHdf5 out;
  const fs::path& file;
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

  explicit Impl(const fs::path& name) : out(name, kHistoryFile), file(out.file()) {}
  Impl(const Impl&) = delete;
  Impl& operator=(const Impl&) = delete;
  ~Impl() {
    const Quiet quiet;
    close_objects();
    out.abandon();
  }

  // Closes all objects of the file, because a file with open objects would stay open.
  herr_t close_objects() {
    herr_t worst = std::min(time.close(), dt.close());
    for (Series& one : series) worst = std::min({worst, one.dataset.close(), one.type.close()});
    return worst;
  }

  // `grows`: the first size has no limit
  Dataset create_dataset(const Quantity& quantity, hid_t type, const Shape& size, const Shape& chunk, bool grows) const;
  void write_meta(const std::map<std::string, std::string>& meta) const;
  void write_array(const Quantity& quantity, hid_t type, const void* values, const Shape& shape) const;
  void append(hid_t dataset, hid_t type, const void* values, const Shape& rows) const;
  void add_series(Quantity quantity);
  void create_series(std::size_t rows_a_chunk);
  Series& in_open_row(std::size_t quantity, std::size_t count, bool bytes);
  void write_waiting_rows();
};

Dataset HistoryWriter::Impl::create_dataset(const Quantity& quantity, hid_t type, const Shape& size, const Shape& chunk,
                                            bool grows) const {
  const Properties creation(checked(H5Pcreate(H5P_DATASET_CREATE), "make a property list"));
  checked(H5Pset_chunk(creation, static_cast<int>(chunk.size()), chunk.data()), "set chunks");
  checked(H5Pset_fletcher32(creation), "set fletcher32");
  Shape most = size;
  if (grows) most.front() = H5S_UNLIMITED;
  Dataset made = make_dataset(out, quantity.name, type, size, creation, most);
  // A reader converts by this text, so it is of fixed length: it lies in the header of its dataset, which has a checksum.
  if (!quantity.units.empty()) put_text(made, "units", quantity.units);
  write_text(made, "long_name", quantity.long_name);
  if (quantity.is_regime) write_text(made, "legend", legend_of_regimes());
  if (quantity.is_outcome) write_text(made, "legend", legend_of_outcomes());
  return made;
}

void HistoryWriter::Impl::write_meta(const std::map<std::string, std::string>& meta) const {
  const Group group = open_group(out, "meta");
  for (const auto& [name, text] : meta) write_text(group, name, text);
}

void HistoryWriter::Impl::add_series(Quantity quantity) {
  Series one;
  one.bytes = quantity.is_regime || quantity.is_outcome;
  if (quantity.is_regime) {
    one.type = Type(checked(H5Tenum_create(H5T_STD_U8LE), "make the regime type"));
    for (const wire::EnumValue& regime : wire::names_of(wire::Regime{}).values) {
      const auto value = static_cast<std::uint8_t>(regime.number);
      checked(H5Tenum_insert(one.type, regime.name, &value), "make the regime type");
    }
  } else {
    one.type = Type(checked(H5Tcopy(one.bytes ? H5T_STD_U8LE : H5T_IEEE_F64LE), "make a type"));
  }
  one.quantity = std::move(quantity);
  series.push_back(std::move(one));
}

// Creates the datasets that have a row for each step, unless they exist.
void HistoryWriter::Impl::create_series(std::size_t rows_a_chunk) {
  if (time >= 0) return;
  const bool all_rows = rows_a_chunk < rows_per_chunk;  // true if the history ends before it fills a chunk
  const Shape times = {all_rows ? rows_a_chunk : std::max(rows_a_chunk, kTimesPerChunk)};
  time = create_dataset({"time", "s", "end of the step"}, H5T_IEEE_F64LE, {0}, times, true);
  put_attribute(time, "t0", H5T_IEEE_F64LE, &start_time);
  if (has_dt)
    dt = create_dataset({"dt", "s", "length of the step as the host took it"}, H5T_IEEE_F64LE, {0}, times, true);
  for (Series& one : series)
    one.dataset = create_dataset(one.quantity, one.type, {0, nodes}, {rows_a_chunk, chunk_width}, true);
}

void HistoryWriter::Impl::append(hid_t dataset, hid_t type, const void* values, const Shape& rows) const {
  Shape size = rows;
  size.front() += rows_written;
  checked(H5Dset_extent(dataset, size.data()), "grow a dataset");
  write_rows(dataset, type, rows_written, rows, values);
}

void HistoryWriter::Impl::write_waiting_rows() {
  const std::size_t rows = waiting_times.size();
  create_series(std::max<std::size_t>(rows, 1));
  if (rows == 0) return;
  append(time, H5T_IEEE_F64LE, waiting_times.data(), {rows});
  if (has_dt) append(dt, H5T_IEEE_F64LE, waiting_dts.data(), {rows});
  for (Series& one : series) {
    append(one.dataset, one.type, one.bytes ? static_cast<const void*>(one.codes.data()) : one.numbers.data(),
           {rows, nodes});
    one.numbers.clear();
    one.codes.clear();
  }
  out.check_written();  // ends a long run at its first failed write
  rows_written += rows;
  waiting_times.clear();
  waiting_dts.clear();
}

HistoryWriter::Impl::Series& HistoryWriter::Impl::in_open_row(std::size_t quantity, std::size_t count, bool bytes) {
  if (!row_open) refuse_file(file, "values outside a row", "Call begin_row first.");
  Series& one = series.at(quantity);
  const std::string& name = one.quantity.name;
  if (one.bytes != bytes)
    refuse_file(
        file, fmt::format("/{} takes {}, given {}", name, one.bytes ? "uint8" : "float64", bytes ? "uint8" : "float64"),
        {}, name);
  if (count != nodes)
    refuse_file(file, fmt::format("/{} takes {} values a row, given {}", name, nodes, count), {}, name);
  if (one.set) refuse_file(file, fmt::format("/{} is set twice in one row", name), {}, name);
  one.set = true;
  return one;
}

void HistoryWriter::Impl::write_array(const Quantity& quantity, hid_t type, const void* values,
                                      const Shape& shape) const {
  Shape chunk = shape;  // the values of one time, or of one node
  hsize_t elements = 1;
  for (std::size_t i = chunk.size(); i-- > 0;) {
    chunk[i] = even_part(chunk[i], std::max<hsize_t>(kMaxChunkWidth / elements, 1));
    elements *= chunk[i];
  }
  hdf5::write(create_dataset(quantity, type, shape, chunk, false), type, values);
}

Quantity quantity_of_column(wire::Field field, std::uint32_t component, const std::string& long_name) {
  const wire::ColumnRow& row = wire::column_row(field);
  return {.name = wire::quantity_of(field, component),
          .units = wire::units_in_files(row),
          .long_name = (long_name.empty() ? row.meaning : long_name) + (component == 0 ? "" : ", second direction"),
          .is_regime = field == wire::Field::kRegime,
          .is_outcome = field == wire::Field::kOutcome};
}

HistoryWriter::HistoryWriter(const fs::path& file, std::span<const std::uint64_t> node_ids,
                             std::vector<Quantity> quantities, const std::map<std::string, std::string>& meta,
                             double start_time_s) {
  if (node_ids.empty()) refuse_file(file, "a history of no nodes", "Name at least one node.");
  impl_ = std::make_unique<Impl>(file);
  Impl& self = *impl_;
  self.nodes = node_ids.size();
  self.rows_per_chunk = std::max<std::size_t>(kChunkElements / self.nodes, 1);
  self.chunk_width = even_part(self.nodes, kMaxChunkWidth);
  self.start_time = self.last_time = start_time_s;
  in_file(self.file, [&] {
    const Quantity id = {"node_id", "1", "the host's number of the interface node"};
    hdf5::write(self.create_dataset(id, H5T_STD_U64LE, {self.nodes}, {self.chunk_width}, false), H5T_STD_U64LE,
                node_ids.data());
    for (Quantity& quantity : quantities) self.add_series(std::move(quantity));
    make_group(self.out, "meta");
    self.write_meta(
        {{"format", "shearbus-history"}, {"version", "1"}, {"created", wire::utc_now()}, {"units_system", "SI"}});
    self.write_meta(meta);
  });
}

HistoryWriter::HistoryWriter(HistoryWriter&&) noexcept = default;
HistoryWriter& HistoryWriter::operator=(HistoryWriter&&) noexcept = default;
HistoryWriter::~HistoryWriter() = default;

bool HistoryWriter::replaces() const {
  return impl_->out.replaces();
}

void HistoryWriter::begin_row(double time_s, std::optional<double> dt_s) {
  Impl& self = *impl_;
  if (self.row_open) refuse_file(self.file, "a row begins inside a row", "Call end_row first.");
  if (!std::isfinite(time_s) || time_s <= self.last_time)
    refuse_file(self.file, fmt::format("a row at {} s after one that ends at {} s", time_s, self.last_time),
                "Times must increase.", "time");
  if (self.rows_written + self.waiting_times.size() == 0) self.has_dt = dt_s.has_value();
  if (dt_s.has_value() != self.has_dt)
    refuse_file(self.file, fmt::format("the row at {} s breaks the rule that all rows have a dt or none", time_s), {},
                "dt");
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
  Impl& self = *impl_;
  if (!self.row_open) refuse_file(self.file, "a row ends that never began", "Call begin_row first.");
  for (const Impl::Series& one : self.series)
    if (!one.set)
      refuse_file(self.file, fmt::format("/{} has no values in the row at {} s", one.quantity.name, self.last_time), {},
                  one.quantity.name);
  self.row_open = false;
  if (self.waiting_times.size() == self.rows_per_chunk) in_file(self.file, [&] { self.write_waiting_rows(); });
}

void HistoryWriter::add_static(const Quantity& quantity, std::span<const double> values) {
  if (values.empty()) refuse_file(impl_->file, fmt::format("/{} has no values", quantity.name), {}, quantity.name);
  add_array(quantity, values, {values.size()});
}

void HistoryWriter::add_array(const Quantity& quantity, std::span<const double> values,
                              const std::vector<std::size_t>& shape) {
  in_file(impl_->file, [&] {
    impl_->write_array(quantity, H5T_IEEE_F64LE, values.data(), {shape.begin(), shape.end()});
  });
}

void HistoryWriter::add_ids(const Quantity& quantity, std::span<const std::uint64_t> ids) {
  in_file(impl_->file, [&] { impl_->write_array(quantity, H5T_STD_U64LE, ids.data(), {ids.size()}); });
}

void HistoryWriter::add_texts(const Quantity& quantity, std::span<const std::string> texts) {
  std::size_t width = 1;  // texts of one width, so that the checksum covers them
  for (const std::string& text : texts) width = std::max(width, text.size());
  std::string cells(texts.size() * width, '\0');
  for (std::size_t i = 0; i < texts.size(); ++i) texts[i].copy(cells.data() + i * width, width);
  in_file(impl_->file, [&] { impl_->write_array(quantity, text_type(width), cells.data(), {texts.size()}); });
}

void HistoryWriter::close(const std::map<std::string, std::string>& closing_meta) {
  Impl& self = *impl_;
  if (self.row_open) refuse_file(self.file, "closed inside a row", "Call end_row first.");
  in_file(self.file, [&] {
    self.write_waiting_rows();
    self.write_meta(closing_meta);
    checked(self.close_objects(), "close the datasets");
    self.out.close_and_publish();
  });
}

}  // namespace shearbus::files
