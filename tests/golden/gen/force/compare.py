import sys, time, numpy as np, manifold3d as mf
from bodies import *
import zones, combine, pairs
from scenes import SCENES

def load(name):
    s=SCENES[name]; st=from_manifold(s['static']); tb=from_manifold(s['tool']); sm=sample(tb,s['h']); sm.convexity=tb.convexity; sm.scene=s
    return s,st,tb,sm
def depth_left(s,F,R,p,factor):
    """volume after moving by factor F"""
    m=s['tool'].transform(np.column_stack([R,p+factor*F]))^s['static']
    return m.volume()
def clear(s,R,p,F):
    """smallest factor that leaves volume < tiny, in 0..3 (3: never)"""
    v0=depth_left(s,F,R,p,0)
    if v0<1e-3: return np.nan
    tiny=1e-4*v0
    grid=np.r_[np.arange(0.1,.9,.2),np.arange(.9,1.5,.04),np.arange(1.6,3.1,.35)]; lo=0.
    for hi in grid:
        if depth_left(s,F,R,p,hi)<tiny: break
        lo=hi
    else: return 3.
    for _ in range(4):
        mid=.5*(lo+hi)
        if depth_left(s,F,R,p,mid)<tiny: hi=mid
        else: lo=mid
    return hi
def run(name,solvers,every=11):
    s,st,tb,sm=load(name); path=s['path']; rad=np.linalg.norm(tb.vertices,axis=1).max()
    mv=np.array([max(np.linalg.norm(tb.vertices@(b[0]-a[0]).T+b[1]-a[1],axis=1).max(),1e-9) for a,b in zip(path,path[1:])])
    out={}
    for lab,(fn,combs) in solvers.items():
        t0=time.time(); found=[fn(st,tb,sm,R,p) for R,p in path]; dt=(time.time()-t0)/len(path)
        for cl,comb in combs.items():
            res=[comb(f) for f in found]; F=np.array([r[0] for r in res]); T=np.array([combine.torque(f,r[1]) for f,r in zip(found,res)])/rad
            a=np.linalg.norm(np.diff(F,axis=0),axis=1)/mv; at=np.linalg.norm(np.diff(T,axis=0),axis=1)/mv
            c=np.array([clear(s,R,p,f) for (R,p),f in list(zip(path,F))[::every] ]); c=c[~np.isnan(c)]
            q=np.percentile(c,[5,50,95]) if len(c) else [np.nan]*3
            out[lab,cl]=(F,T)
            i=a.argmax()
            print(f'{name:11s} {lab:9s} {cl:7s} clear {q[0]:.2f} {q[1]:.2f} {q[2]:.2f}  amp {a.max():7.2f} p99 {np.percentile(a,99):5.2f} at {path[i][1].round(2)} i={i} {F[i].round(2)}->{F[i+1].round(2)}  Fmax {np.linalg.norm(F,axis=1).max():6.2f}  Tamp {at.max():6.2f} n={max(map(len,found))} {dt*1e3:.0f}ms',flush=True)
    return out
COMBS={'c1':lambda f:combine.combine(f,1.),'c2':lambda f:combine.combine(f,2.),'inf':lambda f:combine.combine(f)}
COMBS['c1.5']=lambda f:combine.combine(f,1.5); COMBS['c4']=lambda f:combine.combine(f,4.)
def z(opt): return lambda st,tb,sm,R,p: zones.contacts(st,sm,R,p,opt)
def pr(st,tb,sm,R,p,**kw):
    if not hasattr(sm,'sp'):
        s=sm.scene; sm.sp=pairs.from_parts(st,s['sparts']) if 'sparts' in s else pairs.pieces(st)
        sm.tp=pairs.part_members(sm,s['tparts']) if 'tparts' in s else pairs.members(sm,pairs.pieces(tb)) if tb.flat.all() else [np.arange(len(sm.points))]
    return pairs.contacts(sm.sp,sm.tp,sm,R,p,**kw)
ONE={'c1':COMBS['c1'],'inf':COMBS['inf']}
def sh(a): return lambda *b: pr(*b,sharp=a)
SOLVERS={'f.25':(sh(.25),{'c1':COMBS['c1']}),'f.5':(sh(.5),COMBS),'f1':(sh(1.),{'c1':COMBS['c1']}),'pairs':(pr,COMBS),'zones':(z(zones.Options()),ONE)}
if __name__=='__main__':
    use=[a for a in sys.argv[1:] if a in SOLVERS] or list(SOLVERS)
    for n in [a for a in sys.argv[1:] if a in SCENES] or SCENES:
        st=from_manifold(SCENES[n]['static'])
        run(n,{k:v for k,v in SOLVERS.items() if k in use and (k=='zones' or st.flat.all())})
