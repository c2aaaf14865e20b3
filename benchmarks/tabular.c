/* The loops of rlcore.td, rlcore.traces and rlcore.planning in C, on the same outcome tables, with the same draws.

With PCG64 they continue the stream of a numpy Generator, so that they return the same bits; with NUMPY they ask that
Generator itself for each number, as compiled Python does; with XOSHIRO (256+) they draw more quickly. Compiled by
tabular.py. */

#include <stdint.h>
#include <string.h>

typedef struct {
    int64_t S, A, K, n_episodes, max_steps, n_planning;
    double gamma, alpha, epsilon, lam;
    const int32_t *next_state;
    const double *reward, *cdf, *start_cdf;
    const uint8_t *terminal;
    uint64_t rng[4];
} Task;

#ifdef XOSHIRO
typedef struct { uint64_t s[4]; } Rng;
static Rng seeded(const Task *t) { Rng g; memcpy(g.s, t->rng, sizeof g.s); return g; }
static inline double uniform(Rng *g) {
    uint64_t *s = g->s, result = s[0] + s[3], x = s[1] << 17;
    s[2] ^= s[0]; s[3] ^= s[1]; s[1] ^= s[2]; s[0] ^= s[3]; s[2] ^= x;
    s[3] = s[3] << 45 | s[3] >> 19;
    return (result >> 11) * 0x1p-53;
}
#elif defined NUMPY
typedef struct { void *state; double (*next)(void *); } Rng;
static Rng seeded(const Task *t) { return (Rng){(void *)t->rng[0], (double (*)(void *))t->rng[1]}; }
static inline double uniform(Rng *g) { return g->next(g->state); }
#else
typedef struct { unsigned __int128 state, inc; } Rng;
static Rng seeded(const Task *t) {
    return (Rng){(unsigned __int128)t->rng[0] << 64 | t->rng[1], (unsigned __int128)t->rng[2] << 64 | t->rng[3]};
}
static inline double uniform(Rng *g) {
    g->state = g->state * ((unsigned __int128)2549297995355413924ULL << 64 | 4865540595714422341ULL) + g->inc;
    uint64_t high = g->state >> 64, x = high ^ (uint64_t)g->state;
    unsigned turn = high >> 58;
    return ((x >> turn | x << (-turn & 63)) >> 11) * 0x1p-53;
}
#endif

static inline int64_t draw(const double *cdf, Rng *g) {
    double u = uniform(g);
    int64_t k = 0;
    while (cdf[k] <= u) k++;
    return k;
}

static inline int64_t act(const Task *t, int64_t s, int64_t a, double *r, Rng *g) {
    int64_t at = (s * t->A + a) * t->K, k = at + draw(t->cdf + at, g);
    *r = t->reward[k];
    return t->next_state[k];
}

static inline double max_value(const double *q, int64_t A) {
    double best = q[0];
    for (int64_t a = 1; a < A; a++) best = q[a] > best ? q[a] : best;
    return best;
}

/* every action is legal in the worlds measured */
static inline int64_t epsilon_greedy(const double *q, int64_t A, double epsilon, Rng *g) {
    if (uniform(g) < epsilon) return (int64_t)(uniform(g) * A);
    double best = max_value(q, A);
    int64_t n = 0, a = 0;
    for (int64_t b = 0; b < A; b++) n += q[b] == best;
    int64_t pick = (int64_t)(uniform(g) * n);
    for (;; a++)
        if (q[a] == best && pick-- == 0) return a;
}

int64_t sarsa(const Task *t, double *Q) {
    Rng g = seeded(t);
    int64_t A = t->A, steps = 0;
    for (int64_t k = 0; k < t->n_episodes; k++) {
        int64_t s = draw(t->start_cdf, &g), a = epsilon_greedy(Q + s * A, A, t->epsilon, &g), n = 0, done = 0;
        while (!done) {
            double r;
            int64_t s_next = act(t, s, a, &r, &g), a_next = epsilon_greedy(Q + s_next * A, A, t->epsilon, &g);
            int64_t terminated = t->terminal[s_next];
            Q[s * A + a] += t->alpha * (r + t->gamma * Q[s_next * A + a_next] * !terminated - Q[s * A + a]);
            s = s_next, a = a_next, done = terminated || ++n == t->max_steps, steps++;
        }
    }
    return steps;
}

int64_t q_learning(const Task *t, double *Q) {
    Rng g = seeded(t);
    int64_t A = t->A, steps = 0;
    for (int64_t k = 0; k < t->n_episodes; k++) {
        int64_t s = draw(t->start_cdf, &g), n = 0, done = 0;
        while (!done) {
            double r;
            int64_t a = epsilon_greedy(Q + s * A, A, t->epsilon, &g), s_next = act(t, s, a, &r, &g);
            int64_t terminated = t->terminal[s_next];
            double best = max_value(Q + s_next * A, A);
            Q[s * A + a] += t->alpha * (r + t->gamma * best * !terminated - Q[s * A + a]);
            s = s_next, done = terminated || ++n == t->max_steps, steps++;
        }
    }
    return steps;
}

/* the walk has one action; our loops draw it from pi, and so does this */
int64_t td0(const Task *t, double *V) {
    Rng g = seeded(t);
    const double pi_cdf[1] = {1.0};
    int64_t steps = 0;
    for (int64_t k = 0; k < t->n_episodes; k++) {
        int64_t s = draw(t->start_cdf, &g), done = 0;
        while (!done) {
            double r;
            int64_t a = draw(pi_cdf, &g), s_next = act(t, s, a, &r, &g);
            done = t->terminal[s_next];
            V[s] += t->alpha * (r + t->gamma * V[s_next] * !done - V[s]);
            s = s_next, steps++;
        }
    }
    return steps;
}

int64_t td_lambda(const Task *t, double *V) {
    Rng g = seeded(t);
    const double pi_cdf[1] = {1.0};
    int64_t S = t->S, steps = 0;
    double e[S], decay = t->gamma * t->lam;
    for (int64_t k = 0; k < t->n_episodes; k++) {
        int64_t s = draw(t->start_cdf, &g), done = 0;
        memset(e, 0, sizeof e);
        while (!done) {
            double r;
            int64_t a = draw(pi_cdf, &g), s_next = act(t, s, a, &r, &g);
            done = t->terminal[s_next];
            double step = t->alpha * (r + t->gamma * V[s_next] * !done - V[s]);
            e[s] += 1.0;
            for (int64_t x = 0; x < S; x++) V[x] += step * e[x], e[x] *= decay;
            s = s_next, steps++;
        }
    }
    return steps;
}

int64_t dyna_q(const Task *t, double *Q) {
    Rng g = seeded(t);
    int64_t S = t->S, A = t->A, steps = 0, n_states = 0;
    int64_t next_state[S * A], states[S], actions[S * A], n_actions[S];
    double reward[S * A];
    memset(n_actions, 0, sizeof n_actions);
    memset(next_state, -1, sizeof next_state);
    for (int64_t k = 0; k < t->n_episodes; k++) {
        int64_t s = draw(t->start_cdf, &g), n = 0;
        while (!t->terminal[s] && n++ < t->max_steps) {
            double r;
            int64_t a = epsilon_greedy(Q + s * A, A, t->epsilon, &g), s_next = act(t, s, a, &r, &g), x = s * A + a;
            Q[x] += t->alpha * (r + t->gamma * max_value(Q + s_next * A, A) - Q[x]);
            if (n_actions[s] == 0) states[n_states++] = s;
            if (next_state[x] < 0) actions[s * A + n_actions[s]++] = a;
            next_state[x] = s_next, reward[x] = r;
            for (int64_t j = 0; j < t->n_planning; j++) {
                int64_t i = states[(int64_t)(uniform(&g) * n_states)];
                int64_t y = i * A + actions[i * A + (int64_t)(uniform(&g) * n_actions[i])];
                Q[y] += t->alpha * (reward[y] + t->gamma * max_value(Q + next_state[y] * A, A) - Q[y]);
            }
            s = s_next, steps++;
        }
    }
    return steps;
}
