#include "tests/cli/workplace.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <fstream>
#include <stdexcept>
#include <thread>

namespace viscera::test {
namespace fs = std::filesystem;
namespace {

void link_or_copy(const fs::path& from, const fs::path& to) {
  std::error_code failure;
  fs::create_hard_link(from, to, failure);
  if (failure) fs::copy_file(from, to);
}

[[noreturn]] void become(const fs::path& folder, const std::vector<std::string>& arguments,
                         const std::vector<std::string>& environment) {
  if (chdir(folder.c_str()) != 0) _exit(127);
  for (const auto& variable : environment) putenv(const_cast<char*>(variable.c_str()));
  const std::string mine = std::to_string(getpid());
  const int out = open(("." + mine + ".out").c_str(), O_WRONLY | O_CREAT | O_TRUNC, 0666);
  const int errors = open(("." + mine + ".err").c_str(), O_WRONLY | O_CREAT | O_TRUNC, 0666);
  dup2(out, STDOUT_FILENO);
  dup2(errors, STDERR_FILENO);
  std::vector<char*> pointers;
  for (const auto& argument : arguments) pointers.push_back(const_cast<char*>(argument.c_str()));
  pointers.push_back(nullptr);
  execv(pointers[0], pointers.data());
  _exit(127);
}

}  // namespace

bool contains(const std::string& text, const std::string& part) {
  return text.find(part) != std::string::npos;
}

int count(const std::string& text, const std::string& part) {
  int found = 0;
  for (auto at = text.find(part); at != std::string::npos; at = text.find(part, at + 1)) ++found;
  return found;
}

Workplace::Workplace() : folder_(fs::temp_directory_path()) {
  fs::create_directory(path("bin"));
  const fs::path built = VISCERA_BIN;
  link_or_copy(built / "viscera", path("bin/viscera"));
  for (const char* stage : {"alpha", "beta", "gamma", "delta", "echo", "refit", "many", "census",
                            "grow", "weigh", "device", "loop_one", "loop_two"}) {
    link_or_copy(built / "fake_stage", path(std::string("bin/viscera-") + stage));
  }
  for (int s = 1; s <= 6; ++s)
    link_or_copy(built / "fake_stage", path(fmt::format("bin/viscera-s{}", s)));
  write("volume.txt", "voxels\n");
  write("spec.yaml", R"(viscera: 1
vars:
  input: volume.txt
stages:
  alpha:
    in:
      volume: ${input}
  beta: {size: 4mm}
  gamma: {text: "[draft] page"}
)");
}

void Workplace::write(const std::string& name, const std::string& text) const {
  std::ofstream(path(name)) << text;
}

CommandResult Workplace::viscera(const std::vector<std::string>& arguments,
                                 const std::vector<std::string>& environment) const {
  return finish(start(arguments, environment));
}

CommandResult Workplace::run_spec(const std::string& spec, std::vector<std::string> extra,
                                  const std::vector<std::string>& environment) const {
  extra.insert(extra.begin(), {"run", spec});
  return viscera(extra, environment);
}

CommandResult Workplace::run(const std::vector<std::string>& extra,
                             const std::vector<std::string>& environment) const {
  return run_spec("spec.yaml", extra, environment);
}

pid_t Workplace::start(const std::vector<std::string>& arguments,
                       const std::vector<std::string>& environment) const {
  return start_program("bin/viscera", arguments, environment);
}

pid_t Workplace::start_program(const std::string& program,
                               const std::vector<std::string>& arguments,
                               const std::vector<std::string>& environment) const {
  std::vector<std::string> all = {path(program).string()};
  all.insert(all.end(), arguments.begin(), arguments.end());
  std::vector<std::string> variables = environment;
  variables.push_back("FAKE_LOG=" + path("started.log").string());
  const pid_t process = fork();
  if (process == 0) become(folder_.path(), all, variables);
  return process;
}

CommandResult Workplace::finish(pid_t process) const {
  int status = 0;
  waitpid(process, &status, 0);
  CommandResult result;
  result.exit = WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
  const fs::path out = path(fmt::format(".{}.out", process));
  const fs::path errors = path(fmt::format(".{}.err", process));
  if (fs::exists(out)) result.out = read_file(out);  // a process may be killed before it made them
  if (fs::exists(errors)) result.errors = read_file(errors);
  fs::remove(out);
  fs::remove(errors);
  return result;
}

std::string Workplace::started() const {
  if (!fs::exists(path("started.log"))) return "";
  const std::string text = read("started.log");
  fs::remove(path("started.log"));
  return text;
}

void Workplace::wait_until_started(const std::string& line) const {
  const auto deadline = std::chrono::steady_clock::now() + std::chrono::seconds(20);
  while (std::chrono::steady_clock::now() < deadline) {
    if (fs::exists(path("started.log")) && read("started.log").find(line) != std::string::npos) {
      return;
    }
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
  }
  throw std::runtime_error("never started: " + line);
}

std::map<std::string, std::string> Workplace::snapshot() const {
  std::map<std::string, std::string> files;
  for (const auto& entry : fs::recursive_directory_iterator(folder_.path())) {
    const std::string name = fs::relative(entry.path(), folder_.path()).string();
    struct stat info {};
    lstat(entry.path().c_str(), &info);
    files[name] = fmt::format("{} {} {}", info.st_ino, info.st_mtim.tv_sec, info.st_mtim.tv_nsec);
    if (entry.is_regular_file()) files[name] += read_file(entry.path());
  }
  return files;
}

}  // namespace viscera::test
