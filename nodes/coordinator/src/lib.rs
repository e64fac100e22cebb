//! Commands the formation: relative-attitude laws, experiment sequence, link watch.
