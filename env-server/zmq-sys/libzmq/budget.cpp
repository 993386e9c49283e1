/* SPDX-License-Identifier: MIT OR Apache-2.0 */

#include "budget.hpp"

#include <atomic>

namespace zmq
{
namespace budget
{
//  Engine, session, encoder and what the kernel's side costs here; buffers and queues count themselves.
static const std::size_t per_connection = 16384;
//  Buffers and queues of a connection from its greeting to its first message.
static const std::size_t first_message = 131072;

//  Frames beyond this are large.
static const std::size_t large = 4096;

static std::atomic<int64_t> held (0);
static std::atomic<int64_t> most (-1);
static std::atomic<int> connections (0);
static std::atomic<int> most_connections (-1);

void set_bytes (int64_t bytes_)
{
    most.store (bytes_, std::memory_order_relaxed);
}

void set_connections (int connections_)
{
    most_connections.store (connections_, std::memory_order_relaxed);
}

void add (std::size_t bytes_)
{
    held.fetch_add (static_cast<int64_t> (bytes_), std::memory_order_relaxed);
}

void sub (std::size_t bytes_)
{
    held.fetch_sub (static_cast<int64_t> (bytes_), std::memory_order_relaxed);
}

static bool room_for (std::size_t bytes_, int64_t limit_)
{
    return limit_ < 0
           || held.load (std::memory_order_relaxed)
                  + static_cast<int64_t> (bytes_)
                <= limit_;
}

bool room (std::size_t bytes_)
{
    const int64_t limit = most.load (std::memory_order_relaxed);
    //  What is large leaves a quarter, so that small requests go on when large ones fill the rest.
    return room_for (bytes_, bytes_ > large ? limit - limit / 4 : limit);
}

bool connection ()
{
    const int limit = most_connections.load (std::memory_order_relaxed);
    return (limit < 0 || connections.load (std::memory_order_relaxed) < limit)
           && room_for (per_connection + first_message, most.load (std::memory_order_relaxed));
}

void enter ()
{
    connections.fetch_add (1, std::memory_order_relaxed);
    add (per_connection);
}

void leave ()
{
    connections.fetch_sub (1, std::memory_order_relaxed);
    sub (per_connection);
}
}
}
