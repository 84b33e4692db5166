// What a flow law reads and returns of the vertices of a layer, a vertex in each lane of a register. flow_laws.hpp
// includes this file for one double, and the kernels of solver/flow for registers; so it has no include guard.

// The softening g(P, T) and its derivative dg/dT.
struct Softening {
  Register g{}, slope{};
};

// The load on the layers of the lanes.
struct VertexLoad {
  Register stress;   // magnitude of the shear stress a  [Pa]
  Register pressed;  // 1 + gP P
  Register T_melt;   // melting temperature at P  [K]
};

// The flow of a vertex under the stress a (1 + u) and 1 + w times the heat of the load, where the strain increment dep is
// an explicit function of the stress:
//   dep = max(0, (1 + u)^exponent hot (1 + c1 w + c2 w^2 + c3 w^3) - cold)
// The terms left out are below (growth w)^4.
struct Expansion {
  Register hot, c1, c2, c3, growth;
};

// A vertex before the search for its strain increment.
struct LoadedVertex {
  Register T, rise;    // temperature after the step, and the part of it that is due to the heat of the load  [K]
  Register ep;         // plastic strain before the step
  Register guess{};    // of the root, where has_guess is set
  Mask has_guess{};    //
  Mask wanted;         // lanes whose flow is needed
  Register rest{};     // VertexFlow::rest of the last search, where rest_is_known
  bool rest_is_known;  // the vertex was searched before in this step
};

// The flow of a vertex that was searched for. The root is the logarithm of dep, or of the rate of the law.
struct VertexFlow {
  Register dep, by_load;  // strain increment, and its derivative by ln(a), with the heat of the stress a
  Register root;
  Register rest;  // strength at rest, for the next search
};
