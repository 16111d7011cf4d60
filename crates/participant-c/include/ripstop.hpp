// Solver programs in C++ (11 or later) for Ripstop: classes for ripstop.h, which has shapes, units and signs.
//
// Derive from `ripstop::Participant` and call `ripstop::main<MyParticipant>(argc, argv, ...)`. Throw `ripstop::Fault` (or any
// std::exception) to end the run with its message.
#ifndef RIPSTOP_HPP
#define RIPSTOP_HPP

#include <cstdint>
#include <exception>
#include <memory>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "ripstop.h"

namespace ripstop {

/// An error that ends the run: value, place, cause, remedy.
struct Fault : std::runtime_error {
    using std::runtime_error::runtime_error;
};

/// Message of the last error of the library.
inline std::string message() {
    std::string text(ripstop_message(nullptr, 0) + 1, '\0');
    ripstop_message(&text[0], text.size());
    text.pop_back();
    return text;
}

/// Throws the error of a function of ripstop.h.
inline void check(int code) {
    if (code != 0) throw Fault(message());
}

/// Data of the stage; stays valid as long as the program runs.
class Data {
public:
    explicit Data(const ripstop_data *data) : data_(data) {}

    const ripstop_data *get() const { return data_; }
    std::size_t rank() const { return ripstop_rank(data_); }
    std::size_t ranks() const { return ripstop_ranks(data_); }
    bool is_coupled() const { return ripstop_is_coupled(data_) != 0; }

    ripstop_structure structure() const {
        ripstop_structure structure;
        check(ripstop_get_structure(data_, &structure));
        return structure;
    }
    ripstop_grid grid() const {
        ripstop_grid grid;
        check(ripstop_get_grid(data_, &grid));
        return grid;
    }
    /// The number at a dotted key of the scene.
    double number(const char *key) const {
        double value;
        check(ripstop_number(data_, key, &value));
        return value;
    }
    /// The number at a dotted key of the scene, or `otherwise`.
    double number_or(const char *key, double otherwise) const {
        ripstop_number(data_, key, &otherwise);
        return otherwise;
    }
    bool flag(const char *key) const {
        int value;
        check(ripstop_flag(data_, key, &value));
        return value != 0;
    }
    std::string text(const char *key) const {
        const char *value;
        check(ripstop_text(data_, key, &value));
        return value;
    }
    /// A number of the present stage.
    double stage_number(const char *key) const {
        double value;
        check(ripstop_stage_number(data_, key, &value));
        return value;
    }
    double stage_number_or(const char *key, double otherwise) const {
        ripstop_stage_number(data_, key, &otherwise);
        return otherwise;
    }
    /// The rows `first` to `second` - 1 of `rows` that this rank computes.
    std::pair<std::size_t, std::size_t> share(std::size_t rows) const {
        std::pair<std::size_t, std::size_t> range;
        check(ripstop_share(data_, rows, &range.first, &range.second));
        return range;
    }
    void save_numbers(const char *folder, const std::vector<double> &values) const {
        check(ripstop_save_numbers(data_, folder, values.data(), values.size()));
    }

private:
    const ripstop_data *data_;
};

/// Reads what `Data::save_numbers` wrote; the number of values must be the same.
inline void load_numbers(const char *file, std::vector<double> &values) {
    check(ripstop_load_numbers(file, values.data(), values.size()));
}

/// One rank of a solver program. Its constructor takes a `const ripstop::Data &`.
class Participant {
public:
    explicit Participant(const Data &data) : data(data) {}
    virtual ~Participant() = default;

    /// Rows of this rank's output; those of `Data::share` if not overridden.
    virtual std::vector<std::uint64_t> output_rows() {
        ripstop_structure structure = data.structure();
        std::size_t rows = structure.canopy_nodes;
        if (role == RIPSTOP_ROLE_FLOW) rows = structure.faces;
        if (role == RIPSTOP_ROLE_MESH) rows = data.grid().nodes;
        auto range = data.share(rows);
        std::vector<std::uint64_t> own;
        for (std::size_t row = range.first; row < range.second; ++row) own.push_back(row);
        return own;
    }
    /// Grid nodes that a flow reads where the grid moves.
    virtual std::vector<std::uint64_t> grid_rows() { return {}; }
    /// Computes the window from the last accepted state. `statistics` are zero before.
    virtual void advance(const ripstop_window &window, const ripstop_input &input, double *output, double *statistics) = 0;
    /// The last `advance` becomes the accepted state.
    virtual void accept(const ripstop_window &) {}
    /// Writes the accepted state below `folder`, by `Data::save_numbers` for instance; on the first rank of a program without a
    /// state, an empty one.
    virtual void save(const char *folder) {
        if (data.rank() == 0) data.save_numbers(folder, {});
    }
    /// Reads what `save` wrote.
    virtual void restore(const char *file) {
        std::vector<double> none;
        load_numbers(file, none);
    }
    /// Writes pictures of the accepted state below `folder`.
    virtual void snapshot(double, const char *) {}

    const Data data;
    std::int32_t role = 0;
};

namespace detail {

/// The participant, and rows that the library copies.
struct Context {
    std::int32_t role;
    std::unique_ptr<Participant> participant;
    std::vector<std::uint64_t> rows;
};

/// Runs a call; an exception becomes an error of C.
template <class Call>
int caught(Call call) noexcept {
    try {
        call();
        return 0;
    } catch (const std::exception &e) {
        return ripstop_fault(e.what());
    } catch (...) {
        return ripstop_fault("the program threw an exception that is no std::exception");
    }
}

inline Participant &of(void *user) { return *static_cast<Context *>(user)->participant; }

template <class P>
int start(void *user, const ripstop_data *data) noexcept {
    return caught([&] {
        auto &context = *static_cast<Context *>(user);
        context.participant.reset(new P(Data(data)));
        context.participant->role = context.role;
    });
}

template <std::vector<std::uint64_t> (Participant::*Rows)()>
const std::uint64_t *rows(void *user, std::size_t *count) noexcept {
    auto &context = *static_cast<Context *>(user);
    *count = 0;
    if (caught([&] { context.rows = (of(user).*Rows)(); }) != 0) return nullptr;
    *count = context.rows.size();
    return context.rows.data();
}

inline int advance(void *user, const ripstop_window *window, const ripstop_input *input, double *output, std::size_t,
                   double *statistics) noexcept {
    return caught([&] { of(user).advance(*window, *input, output, statistics); });
}
inline int accept(void *user, const ripstop_window *window) noexcept {
    return caught([&] { of(user).accept(*window); });
}
inline int save(void *user, const char *folder) noexcept {
    return caught([&] { of(user).save(folder); });
}
inline int restore(void *user, const char *file) noexcept {
    return caught([&] { of(user).restore(file); });
}
inline int snapshot(void *user, double time, const char *folder) noexcept {
    return caught([&] { of(user).snapshot(time, folder); });
}

}  // namespace detail

/// Serves a participant of the class `P` to the coupler; the exit code of the process. `effects` are separated by spaces.
template <class P>
int main(int argc, char **argv, std::int32_t role, const char *name, const char *effects, bool needs_grid) {
    detail::Context context{role, nullptr, {}};
    ripstop_program program{};
    program.size = sizeof program;
    program.role = role;
    program.needs_grid = needs_grid;
    program.name = name;
    program.effects = effects;
    program.user = &context;
    program.start = detail::start<P>;
    program.output_rows = detail::rows<&Participant::output_rows>;
    if (role == RIPSTOP_ROLE_FLOW && needs_grid) program.grid_rows = detail::rows<&Participant::grid_rows>;
    program.advance = detail::advance;
    program.accept = detail::accept;
    program.save = detail::save;
    program.restore = detail::restore;
    program.snapshot = detail::snapshot;
    return ripstop_participant_main(argc, argv, &program);
}

}  // namespace ripstop

#endif
