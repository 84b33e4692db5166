// A disk in memory that can fail, or die with the process or the power, at any of its calls.
//
// Each file knows what was written and what was synced; so does the directory of its names. After die() the next server
// finds what such a death leaves: of the process, everything written; of the power, what was synced and, of the rest, a
// part that `random` picks.
#pragma once

#include <algorithm>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <random>
#include <string>
#include <vector>

#include "server/store/storage.hpp"

namespace shearbus::support {

// What a server that died does: nothing any more.
struct Died : store::StorageError {
  Died() : StorageError("the machine has died", EIO) {}
};

class MemoryStorage final : public store::Storage {
 public:
  enum class Call { kAppend, kTruncate, kSync, kCreate, kOpen, kRename, kRemove, kSyncDirectory, kRead, kList };
  struct Fault {
    std::uint64_t at_call = 0;  // counted from 1, over the calls `of` picks
    int code = 0;               // errno to fail with; 0: die
    bool for_ever = false;      // every later call of the kind fails as well
    std::optional<Call> of;     // none: every call
  };

  void plan(Fault fault) {
    fault_ = fault;
    calls_ = 0;
    dead_ = false;
  }
  void heal() { fault_.reset(); }
  std::uint64_t calls() const { return calls_; }
  bool dead() const { return dead_; }
  bool fired() const { return fault_ && calls_ >= fault_->at_call; }

  // The machine starts again.
  void die_of_process() {
    dead_ = false;
    heal();
  }
  void die_of_power(std::mt19937& random) {
    dead_ = false;
    heal();
    // Names first: each change since the last sync of the directory has happened or not, up to a point.
    const std::size_t kept =
        changes_.empty() ? 0 : std::uniform_int_distribution<std::size_t>(0, changes_.size())(random);
    auto names = durable_names_;
    for (std::size_t i = 0; i < kept; ++i) changes_[i](names);
    names_ = durable_names_ = names;
    changes_.clear();
    for (auto& [name, node] : names_) {
      Node& file = *node;
      if (file.written.size() > file.synced.size()) {
        const std::size_t more =
            std::uniform_int_distribution<std::size_t>(0, file.written.size() - file.synced.size())(random);
        file.written.resize(file.synced.size() + more);
        // Of a file that grew, the last blocks may never have been filled.
        if (random() % 4 == 0)
          std::fill(file.written.begin() + static_cast<std::ptrdiff_t>(file.synced.size()), file.written.end(),
                    std::byte{0});
      } else {
        file.written = file.synced;
      }
      file.synced = file.written;
    }
  }

  std::vector<std::string> list() override {
    enter(Call::kList);
    std::vector<std::string> names;
    for (const auto& [name, node] : names_) names.push_back(name);
    return names;
  }
  std::vector<std::byte> read(const std::string& name) override {
    enter(Call::kRead);
    return find(name)->written;
  }
  std::unique_ptr<store::File> create(const std::string& name) override {
    enter(Call::kCreate);
    if (names_.contains(name)) throw store::StorageError("cannot make " + name, EEXIST);
    auto node = std::make_shared<Node>();
    change([=](Names& names) { names[name] = node; });
    return std::make_unique<OpenFile>(*this, node);
  }
  std::unique_ptr<store::File> open(const std::string& name) override {
    enter(Call::kOpen);
    return std::make_unique<OpenFile>(*this, find(name));
  }
  void rename(const std::string& from, const std::string& to) override {
    enter(Call::kRename);
    find(from);
    change([=](Names& names) {
      const auto node = names[from];
      names.erase(from);
      if (node) names[to] = node;
    });
  }
  void remove(const std::string& name) override {
    enter(Call::kRemove);
    find(name);
    change([=](Names& names) { names.erase(name); });
  }
  void sync_directory() override {
    enter(Call::kSyncDirectory);
    durable_names_ = names_;
    changes_.clear();
  }

  // For tests that damage files by hand.
  std::vector<std::byte>& bytes(const std::string& name) { return find(name)->written; }
  void put(const std::string& name, std::vector<std::byte> bytes) {
    names_[name] = std::make_shared<Node>(Node{bytes, bytes});
    durable_names_ = names_;
  }
  bool exists(const std::string& name) const { return names_.contains(name); }
  std::vector<std::string> names() const {
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
      const bool fails = disk_.fails(Call::kAppend);
      // A call that fails or dies may have written any part; half of it is the hardest to tell from whole.
      if (fails) all.resize(all.size() / 2);
      node_->written.insert(node_->written.end(), all.begin(), all.end());
      if (fails) disk_.fail();
    }
    void truncate(std::uint64_t size) override {
      disk_.enter(Call::kTruncate);
      node_->written.resize(size);
      if (node_->synced.size() > size) node_->synced.resize(size);
    }
    void sync() override {
      disk_.enter(Call::kSync);
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
  void enter(Call call) {
    if (fails(call)) fail();
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

  Names names_;
  Names durable_names_;
  std::vector<std::function<void(Names&)>> changes_;  // of names, since the directory was synced
  std::optional<Fault> fault_;
  std::uint64_t calls_ = 0;
  bool dead_ = false;
};

}  // namespace shearbus::support
