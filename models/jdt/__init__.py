"""Joint detection and tracking with adaptive multiple motion models (paper 1).

A particle is [state, motion model, existence]. `filter` is the step of Fig. 6, `multi_object` runs one filter an
object and one that searches; `switching` and `density` choose the next motion model from the last one and from
where the object is (Eq. 10 to 14), `motion` and `motion_prior` move the state, `births` and `row_profile` say
where objects appear and how large and fast they are there, `existence` is the chain of Eq. 5, `resampling` draws.
"""
