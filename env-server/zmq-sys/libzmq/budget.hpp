/* SPDX-License-Identifier: MIT OR Apache-2.0 */

//  What libzmq holds for all peers of this process, and how much that may be.
//
//  Counted are frames, receive buffers, the chunks of queues, and a round sum for each connection.
//  The places where a peer makes that grow ask first: a new connection, a new frame. One that may
//  not grow loses its connection; nothing else happens to anybody.

#ifndef RODGYM_BUDGET_HPP
#define RODGYM_BUDGET_HPP

#include <cstddef>
#include <cstdint>

namespace zmq
{
namespace budget
{
//  Numbers of socket options that no libzmq has; those of bytes and connections concern the process.
enum
{
    option_max_parts = 0x726401,
    option_bytes = 0x726402,
    option_connections = 0x726403
};

//  -1: no limit.
void set_bytes (int64_t bytes_);
void set_connections (int connections_);

void add (std::size_t bytes_);
void sub (std::size_t bytes_);

//  Whether so much more may be taken.
bool room (std::size_t bytes_);

//  Whether one more connection may be accepted.
bool connection ();

//  A connection begins and ends.
void enter ();
void leave ();
}
}

#endif
