// A disk in memory for tests. It can fail at any of its calls. At any call the process of the server may also die, or
// the machine may lose power.
//
// Each file has a written and a synced content, and the directory has written and synced names. If the process dies,
// the next server finds everything that was written. If the power is lost, it finds what was synced and a random part
// of what was only written.
#pragma once

#include <algorithm>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <random>
#include <string>
#include <vector>

#include "server/store/storage.hpp"

namespace shearbus::support {

// Thrown by the call at which the server dies, and by every later call.
struct Died : store::StorageError {
  Died() : StorageError("the machine has died", EIO) {}
};

class MemoryStorage final : public store::Storage {
 public:
  enum class Call { kAppend, kOverwrite, kTruncate, kSync, kCreate, kRename, kRemove, kSyncDirectory, kRead, kList };
  struct Fault {
    std::uint64_t at_call = 0;  // number of the failing call, from 1, counted among the calls selected by `of`
    int code = 0;               // errno of the failing call; 0: process or machine dies at this call
    bool for_ever = false;      // after the failing call all later calls selected by `of` fail, too
    std::optional<Call> of;     // kind of the calls that are counted and fail; absent: every kind
  };

  void plan(Fault fault) {
    const auto turn = this->turn();
    fault_ = fault;
    calls_ = 0;
    dead_ = false;
  }
  void heal() {
    const auto turn = this->turn();
    fault_.reset();
  }
  std::uint64_t calls() const {
    const auto turn = this->turn();
    return calls_;
  }
  bool dead() const {
    const auto turn = this->turn();
    return dead_;
  }
  bool fired() const {
    const auto turn = this->turn();
    return fault_ && calls_ >= fault_->at_call;
  }

  // die_of_process() restarts the disk after a death of the process, die_of_power() after a loss of power.
  void die_of_process() {
    dead_ = false;
    heal();
  }
  void die_of_power(std::mt19937& random) {
    dead_ = false;
    heal();
    // A random number of the first changes of names since the last sync of the directory survive.
    const std::size_t kept =
        changes_.empty() ? 0 : std::uniform_int_distribution<std::size_t>(0, changes_.size())(random);
    auto names = durable_names_;
    for (std::size_t i = 0; i < kept; ++i) changes_[i](names);
    names_ = durable_names_ = names;
    changes_.clear();
    for (auto& [name, node] : names_) {
      Node& file = *node;
      // Bytes that were written over synced bytes have reached the disk or have not, with equal probability.
      if (random() % 2 == 0)
        std::copy_n(file.synced.begin(), std::min(file.synced.size(), file.written.size()), file.written.begin());
      if (file.written.size() > file.synced.size()) {
        const std::size_t more =
            std::uniform_int_distribution<std::size_t>(0, file.written.size() - file.synced.size())(random);
        file.written.resize(file.synced.size() + more);
        // A file system may not have written the last blocks of a file that grew: they then read as zeros.
        if (random() % 4 == 0)
          std::fill(file.written.begin() + static_cast<std::ptrdiff_t>(file.synced.size()), file.written.end(),
                    std::byte{0});
      } else if (file.written.size() < file.synced.size()) {
        file.written = file.synced;
      }
      file.synced = file.written;
    }
  }

  std::vector<std::string> list() override {
    const auto turn = enter(Call::kList);
    std::vector<std::string> names;
    for (const auto& [name, node] : names_) names.push_back(name);
    return names;
  }
  std::vector<std::byte> read(const std::string& name) override {
    const auto turn = enter(Call::kRead);
    return find(name)->written;
  }
  std::unique_ptr<store::File> create(const std::string& name) override {
    const auto turn = enter(Call::kCreate);
    if (names_.contains(name)) throw store::StorageError("cannot make " + name, EEXIST);
    auto node = std::make_shared<Node>();
    change([=](Names& names) { names[name] = node; });
    return std::make_unique<OpenFile>(*this, node);
  }
  void rename(const std::string& from, const std::string& to) override {
    const auto turn = enter(Call::kRename);
    find(from);
    change([=](Names& names) {
      const auto node = names[from];
      names.erase(from);
      if (node) names[to] = node;
    });
  }
  void remove(const std::string& name) override {
    const auto turn = enter(Call::kRemove);
    find(name);
    change([=](Names& names) { names.erase(name); });
  }
  void sync(const std::string& name) override {
    const auto turn = enter(Call::kSync);
    const auto file = find(name);
    file->synced = file->written;
  }
  void sync_directory() override {
    const auto turn = enter(Call::kSyncDirectory);
    durable_names_ = names_;
    changes_.clear();
  }

  // Gives access to the bytes of a file, for tests that damage files.
  std::vector<std::byte>& bytes(const std::string& name) { return find(name)->written; }
  void put(const std::string& name, const std::vector<std::byte>& bytes) {
    names_[name] = std::make_shared<Node>(Node{bytes, bytes});
    durable_names_ = names_;
  }
  bool exists(const std::string& name) const {
    const auto turn = this->turn();
    return names_.contains(name);
  }
  std::vector<std::string> names() const {
    const auto turn = this->turn();
    std::vector<std::string> all;
    for (const auto& [name, node] : names_) all.push_back(name);
    return all;
  }

 private:
  struct Node {
    std::vector<std::byte> written;
    std::vector<std::byte> synced;
  };
  using Names = std::map<std::string, std::shared_ptr<Node>>;

  class OpenFile final : public store::File {
   public:
    OpenFile(MemoryStorage& disk, std::shared_ptr<Node> node) : disk_(disk), node_(std::move(node)) {}
    void append(std::span<const store::Bytes> parts) override {
      std::vector<std::byte> all;
      for (const store::Bytes part : parts) all.insert(all.end(), part.begin(), part.end());
      const auto turn = disk_.turn();
      const bool fails = disk_.fails(Call::kAppend);
      // A failing call may have written any part of its data. Half of the data is hardest to distinguish from all of
      // it.
      if (fails) all.resize(all.size() / 2);
      node_->written.insert(node_->written.end(), all.begin(), all.end());
      if (fails) disk_.fail();
    }
    void overwrite(std::uint64_t offset, store::Bytes bytes) override {
      const auto turn = disk_.enter(Call::kOverwrite);
      std::copy(bytes.begin(), bytes.end(), node_->written.begin() + static_cast<std::ptrdiff_t>(offset));
    }
    void truncate(std::uint64_t size) override {
      const auto turn = disk_.enter(Call::kTruncate);
      node_->written.resize(size);
      if (node_->synced.size() > size) node_->synced.resize(size);
    }
    void sync() override {
      const auto turn = disk_.enter(Call::kSync);
      node_->synced = node_->written;
    }

   private:
    MemoryStorage& disk_;
    std::shared_ptr<Node> node_;
  };

  bool fails(Call call) {
    if (dead_) return true;
    if (!fault_ || (fault_->of && *fault_->of != call)) {
      if (!fault_) ++calls_;
      return false;
    }
    ++calls_;
    return calls_ == fault_->at_call || (fault_->for_ever && calls_ > fault_->at_call);
  }
  [[noreturn]] void fail() {
    if (dead_ || fault_->code == 0) {
      dead_ = true;
      throw Died{};
    }
    throw store::StorageError("the disk of the test fails", fault_->code);
  }
  // A checkpoint is written by a thread of its own, while the server appends to its journal.
  std::unique_lock<std::mutex> turn() const { return std::unique_lock(*mutex_); }
  [[nodiscard]] std::unique_lock<std::mutex> enter(Call call) {
    auto turn = this->turn();
    if (fails(call)) fail();
    return turn;
  }
  void change(std::function<void(Names&)> how) {
    how(names_);
    changes_.push_back(std::move(how));
  }
  std::shared_ptr<Node> find(const std::string& name) {
    const auto found = names_.find(name);
    if (found == names_.end()) throw store::StorageError("cannot find " + name, ENOENT);
    return found->second;
  }

  std::unique_ptr<std::mutex> mutex_ = std::make_unique<std::mutex>();  // of all that follows; a disk can be moved
  Names names_;
  Names durable_names_;
  std::vector<std::function<void(Names&)>> changes_;  // changes of names since the last sync of the directory
  std::optional<Fault> fault_;
  std::uint64_t calls_ = 0;
  bool dead_ = false;
};

}  // namespace shearbus::support
