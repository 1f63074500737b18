"""Candidate "pairs": both bodies covered by convex pieces, one half-space per pair of pieces."""
from __future__ import annotations
import numpy as np, networkx as nx, manifold3d as mf
from scipy.optimize import nnls
from zones import Contact
from bodies import from_manifold

def pieces(body):
    """Maximal sets of patches that are convexly related pairwise and hang together by creases."""
    n=len(body.flat); g=nx.Graph(); g.add_nodes_from(range(n)); g.add_edges_from((i,j) for i in range(n) for j in range(i) if body.convexity[i,j]==1.)
    meet=nx.Graph(); meet.add_nodes_from(range(n)); meet.add_edges_from(zip(np.repeat(body.patch,3),body.patch[body.beside].ravel()))
    out=set()
    for c in nx.find_cliques(g):
        for part in nx.connected_components(meet.subgraph(c)): out.add(frozenset(int(i) for i in part))
    out=[c for c in out if not any(c<d for d in out)]
    return [(body.patch_normal[list(c)],np.einsum('ij,ij->i',body.patch_normal[list(c)],body.patch_point[list(c)]),sorted(c)) for c in out]
def from_parts(body,parts):
    """Planes of each convex part that are faces of the body."""
    out=[]
    for m in parts:
        q=from_manifold(m); keep=[]
        for n,p in zip(q.patch_normal,q.patch_point):
            for b in range(len(body.flat)):
                if body.flat[b] and body.patch_normal[b]@n>1-1e-9 and abs((body.patch_point[b]-p)@n)<1e-6: keep.append((n,p@n)); break
        out.append((np.array([k[0] for k in keep]),np.array([k[1] for k in keep]),q))
    return out
def part_members(tool,parts):
    return [np.flatnonzero(((q.patch_point*q.patch_normal).sum(1)-tool.points@q.patch_normal.T).min(1)>=-1e-6) for q in map(from_manifold,parts)]
def overhang(body,man):
    """Volume of each piece outside the solid."""
    out=[]
    for N,c,_ in pieces(body):
        box=mf.Manifold.cube([400,400,400],True)
        for a,b in zip(N,c): box=box.trim_by_plane((-a).tolist(),-float(b))
        out.append((box-man).volume())
    return out
def sp_box(sp):
    qs=[q for _,_,q in sp if not isinstance(q,list)]
    if len(qs)<len(sp): return np.full(3,-1e3),np.full(3,1e3)
    return np.min([q.vertices.min(0) for q in qs],0),np.max([q.vertices.max(0) for q in qs],0)
def contacts(sp,tp,tool,R,p,power=1,sharp=0.):
    """sp: static pieces; tp: per tool piece the indices of its samples."""
    X=tool.points@R.T+p; found=[]
    lo,hi=sp_box(sp); near=((X>lo)&(X<hi)).all(1); new=np.cumsum(near)-1
    tp=[new[i[near[i]]] for i in tp]; X=X[near]; areas=tool.areas[near]@R.T
    for N,c,q in sp:
        H=c-X@N.T; inside=H.min(1)>=-1e-9
        if not isinstance(q,list): inside&=((q.patch_point*q.patch_normal).sum(1)-X@q.patch_normal.T).min(1)>=-1e-9
        phi=np.maximum(H.min(1),0)
        for idx in tp:
            s=idx[inside[idx]]
            if not len(s): continue
            push=-(phi[s]**power)[:,None]*areas[s]; S=push.sum(0)
            co,_=nnls(N.T,S)
            if sharp: r=co/max(co.max(),1e-300); co=co.max()*np.maximum(0,1+sharp-sharp/np.maximum(r,1e-9))
            n=co@N; L=np.linalg.norm(n)
            if L<1e-12: continue
            n/=L; rate=N@n
            with np.errstate(divide='ignore',invalid='ignore'): e=np.where(rate>1e-9,np.maximum(H[s],0)/rate,np.inf).min(1)
            d=e[np.isfinite(e)].max(initial=0)
            if d>0: found.append(Contact(n,float(d),np.cross(X[s]-p,push).sum(0)/L))
    return found
def members(tool,tp): return [np.flatnonzero((c-tool.points@N.T).min(1)>=-1e-6) for N,c,_ in tp]
