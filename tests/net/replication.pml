/* A home and its mirrors over a network that loses, doubles and reorders: see docs/replication.md.

   A commit is (epoch, number, value). Values are fresh, so that states are compared by them. An answer
   with a state is a message like any other: it may arrive after later commits and promotions. An answer
   with commits is the same as old commits that are sent again.

   Faults that are put in: BUG_NOEPOCH (a mirror looks at no epoch), BUG_GAP (it skips a commit),
   BUG_NORESYNC (it enters an epoch without a state), BUG_OLDSTATE (it takes a state of an earlier
   epoch), BUG_FORK (it enters an epoch from another commit than the fork), BUG_TWICE (a request of another machine is not noted with its commit), BUG_EQUALEPOCH (two
   promoted mirrors have equal epochs). */
#ifndef N
#define N 3        /* nodes; node 0 begins as the home */
#endif
#ifndef MAXC
#define MAXC 2     /* commits of a node; at most 2, for a state is one byte */
#endif
#ifndef MAXE
#define MAXE 3     /* epochs */
#endif
#ifndef CH
#define CH 2       /* messages under way */
#endif
#ifndef KILLS
#define KILLS 1
#endif
#define REQUEST 9  /* the value of a request's commit */
#ifdef BUG_GAP
#define NEXT(k, n) (k > n)
#else
#define NEXT(k, n) (k == n + 1)
#endif
#ifdef BUG_FORK
#define AT_FORK(k, n) true
#else
#define AT_FORK(k, n) (k == n)
#endif
#ifdef BUG_OLDSTATE
#define LATER(e, k, m) (e != log[m].e || k > log[m].n)
#else
#define LATER(e, k, m) (e > log[m].e || (e == log[m].e && k > log[m].n))
#endif

typedef Log { byte v[3]; byte n; byte e; bit req };
Log log[N];
bit home[N]; bit up[N];
typedef History { byte v[3]; byte n };
History had[MAXE + 1];  /* what the home of each epoch had */
byte from_e[MAXE + 1], from_n[MAXE + 1];  /* the fork of each epoch, which its heads tell */
byte fresh = 1; byte latest = 1; byte kills = 0;
chan net = [CH] of { bit, byte, byte, byte };  /* is a state, epoch, number, value or state */
byte i_;

/* The mirror has what the home of its epoch had, and has not gone back. */
inline check(m) {
  assert(log[m].e > last_e || (log[m].e == last_e && log[m].n >= last_n));
  last_e = log[m].e; last_n = log[m].n;
  i_ = 1;
  do
  :: i_ <= log[m].n ->
       assert(i_ <= had[log[m].e].n && log[m].v[i_] == had[log[m].e].v[i_]); i_++
  :: else -> break
  od;
  i_ = 0
}
inline commit(h, value) {
  log[h].n++; log[h].v[log[h].n] = value;
  had[log[h].e].n = log[h].n; had[log[h].e].v[log[h].n] = value;
  if :: nfull(net) -> net!0, log[h].e, log[h].n, value :: skip fi
}

proctype Node(byte me) {
  byte e, k, v, last_e, last_n; bit whole;
  do
  :: atomic { up[me] && home[me] && log[me].n < MAXC && fresh < 6 ->
       commit(me, fresh); fresh++ }
  :: atomic { up[me] && home[me] && log[me].n < MAXC &&  /* a request, sent again while unanswered */
#ifndef BUG_TWICE
       log[me].req == 0 ->
       log[me].req = 1;
#else
       true ->
#endif
       i_ = 1;
       do :: i_ <= log[me].n -> assert(log[me].v[i_] != REQUEST); i_++ :: else -> break od;
       i_ = 0;
       commit(me, REQUEST) }
  :: atomic { up[me] && home[me] && log[me].n > 0 && nfull(net) ->  /* again: doubled, or asked for */
       select(k : 1 .. MAXC);
       if :: k <= log[me].n -> net!0, log[me].e, k, log[me].v[k] :: else -> skip fi;
       k = 0 }
  :: atomic { up[me] && home[me] && nfull(net) ->  /* a state that was asked for */
       net!1, log[me].e, log[me].n, log[me].v[1] + 10 * log[me].v[2] }
  :: atomic { up[me] && nempty(net) -> net??whole, e, k, v;  /* in any order */
       if
#ifdef BUG_NOEPOCH
       :: !whole && !home[me] && k == log[me].n + 1 && k <= MAXC ->
            log[me].n = k; log[me].v[k] = v; check(me)
#else
       :: !whole && !home[me] && e == log[me].e && NEXT(k, log[me].n) && k <= MAXC ->
            log[me].n = k; log[me].v[k] = v;
            if :: v == REQUEST -> log[me].req = 1 :: else fi;
            check(me)
#endif
       /* It is told of the fork by a head: here any message of the epoch is one. */
       :: !whole && !home[me] && e > log[me].e && log[me].e != 0 && from_e[e] == log[me].e &&
          AT_FORK(from_n[e], log[me].n) -> log[me].e = e; check(me)
#ifdef BUG_NORESYNC
       :: !whole && !home[me] && e > log[me].e -> log[me].e = e; check(me)
#endif
       :: whole && !home[me] && LATER(e, k, me) ->
            log[me].e = e; log[me].n = k;
            log[me].v[1] = v % 10; log[me].v[2] = v / 10;
            log[me].req = (log[me].v[1] == REQUEST || log[me].v[2] == REQUEST);
            check(me)
       :: home[me] && e > log[me].e -> home[me] = 0  /* it stops; it follows from now on */
       :: else -> skip  /* nobody takes it: it is lost */
       fi;
       whole = 0; e = 0; k = 0; v = 0 }
  :: atomic { up[me] && !home[me] && latest < MAXE ->  /* promoted, also while the old home lives */
#ifdef BUG_EQUALEPOCH
       if :: log[me].e < latest -> skip :: else -> latest++ fi;
#else
       latest++;
#endif
       from_e[latest] = log[me].e; from_n[latest] = log[me].n;
       log[me].e = latest; home[me] = 1;
       had[latest].n = log[me].n; had[latest].v[1] = log[me].v[1]; had[latest].v[2] = log[me].v[2] }
  :: atomic { up[me] && kills < KILLS -> up[me] = 0; kills++ }
  :: atomic { !up[me] ->  /* back, empty */
       up[me] = 1; home[me] = 0; log[me].n = 0; log[me].e = 0; log[me].req = 0;
       log[me].v[1] = 0; log[me].v[2] = 0; last_e = 0; last_n = 0 }
  od
}
init {
  atomic {
    log[0].e = 1; home[0] = 1;
    i_ = 0;
    do :: i_ < N -> up[i_] = 1; run Node(i_); i_++ :: else -> break od;
    i_ = 0
  }
}
