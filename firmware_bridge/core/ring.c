#include "core/ring.h"

_Static_assert((RING_FRAMES & (RING_FRAMES - 1)) == 0, "indices wrap at 2^32");

bool ring_put(struct ring *ring, const union bridge_frame *frame, uint32_t keep_free)
{
    const uint32_t head = atomic_load_explicit(&ring->head, memory_order_relaxed);
    const uint32_t tail = atomic_load_explicit(&ring->tail, memory_order_acquire);
    if (head - tail + keep_free >= RING_FRAMES) {
        return false;
    }
    ring->slots[head % RING_FRAMES] = *frame;
    atomic_store_explicit(&ring->head, head + 1U, memory_order_release);
    return true;
}

bool ring_take(struct ring *ring, union bridge_frame *frame)
{
    const uint32_t tail = atomic_load_explicit(&ring->tail, memory_order_relaxed);
    const uint32_t head = atomic_load_explicit(&ring->head, memory_order_acquire);
    if (head == tail) {
        return false;
    }
    *frame = ring->slots[tail % RING_FRAMES];
    atomic_store_explicit(&ring->tail, tail + 1U, memory_order_release);
    return true;
}
